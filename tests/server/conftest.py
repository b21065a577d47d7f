"""Answers that many tests read; and whatever table any of them has printed is laid out for other terminals too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from server.commands import console
from tests.server.command_line import H01, Document, run

WIDTHS = (60, 80, 100, 140)


@pytest.fixture(autouse=True, scope="session")
def _tables_fit_every_terminal() -> Iterator[None]:
    lay_out = console.table_lines

    def checked(columns: Sequence[str], rows: Sequence[Sequence[Any]], wide: int) -> list[str]:
        words = {word for row in rows for cell in row for word in console.shown(cell).split()}
        longest = max(map(len, words), default=0)
        for width in WIDTHS:
            lines = lay_out(columns, rows, width)
            assert words <= {word for line in lines for word in line.split()}, (width, columns)
            assert max(map(len, lines), default=0) <= max(width, longest + 8), (width, columns)
        return lay_out(columns, rows, wide)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(console, "table_lines", checked)
        yield


@pytest.fixture(scope="session")
def compared() -> Document:
    """What `compare` answers of a published session; for reading only."""
    return run("compare", H01, "--json", "-").body("compare")


@pytest.fixture(scope="session")
def revision(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Document]:
    """A revision by `refit`, and what it answered; for reading only."""
    path = tmp_path_factory.mktemp("revision") / "new" / "H01-r1.json"
    return path, run("refit", H01, "--out", path, "--json", "-").body("refit")


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a simulated session of published forces; for reading only."""
    folder = tmp_path_factory.mktemp("simulated") / "rig"
    body = run("simulate", "synek2019", "--out", folder, "--rate-hz", 20, "--seed", 3, "--json", "-").body("simulate")
    assert body["cases"] == 40
    return folder
