"""A process that serves the small guarded application: `python -m tests.server.service.small_service JSON`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from server.service.serve import serve
from server.service.settings import Settings
from tests.server.service.guarded import Guarded


def main() -> None:
    given: dict[str, Any] = json.loads(sys.argv[1])

    def make(settings: Settings) -> Any:
        return Guarded(settings.data, host=settings.host).app

    serve(Settings(**given), make, lambda address: print(address, flush=True))


if __name__ == "__main__":
    print(Path.cwd().name, file=sys.stderr)
    main()
