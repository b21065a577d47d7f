"""What is loaded before a service has threads."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PROGRAM = """
import sys
from pathlib import Path
from server.service.services import build
from server.service.settings import Settings

build(Settings(data=Path(sys.argv[1])))
before = set(sys.modules)
import numpy, pyarrow
pyarrow.array(numpy.zeros(3))
print([m for m in set(sys.modules) - before if m.split(".")[0] == "pandas"])
"""


def test_the_first_array_of_arrow_loads_nothing_that_another_thread_could_meet_half_loaded(tmp_path: Path) -> None:
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, "-c", PROGRAM, str(tmp_path / "data")], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "[]"
