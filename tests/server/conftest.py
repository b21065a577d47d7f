"""Whatever table any of these tests has printed is laid out for other terminals too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from server.commands import console

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
