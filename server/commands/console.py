"""Output of the command line: JSON answers, tables, progress, and one clear line for bad input."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.files import replacing
from daq.plain_json import clean

# Of tables: before the first column, and between columns.
_INDENT, _GAP = 2, 2
_NUMBERS = re.compile(r"[\s\d.+-]+")


def answer(command: str, body: dict[str, Any], json_file: str | None) -> bool:
    """Write the JSON answer of a command if it was asked for.

    Args:
        command: name in the schema.
        body: of the answer; NaN and infinities become null.
        json_file: path, `-` for standard output, or None.

    Returns:
        Whether the answer went to standard output, so that nothing else may.

    Raises:
        InputError: the file cannot be written.
    """
    if json_file is None:
        return False
    text = json.dumps(clean({"schema": f"fingertwin/{command}/1"} | body), indent=1, allow_nan=False)
    if json_file == "-":
        sys.stdout.write(text + "\n")
        return True
    path = Path(json_file)
    try:
        with replacing(path) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path} ({error.strerror})", "a path that can be written") from error
    return False


def refuse_useless(why: str, expected: str, **options: object) -> None:
    """Refuse options that would change nothing, so that none is ignored in silence.

    Args:
        why: nothing would change, such as "without --to".
        expected: what gives them an effect.
        options: by name; None or an empty list was not given.

    Raises:
        InputError: one is given.
    """
    for name, value in options.items():
        if value is not None and value != []:
            raise InputError(f"--{name} {why} has no effect", expected, "Leave it out otherwise")


def say(text: str = "") -> None:
    """Print a line of text; on a terminal, sentences break between words, so that no number is cut.

    A line with a command stays whole, so that it can be copied.
    """
    wide = _known_width()
    if wide and "fingertwin " not in text:
        indent = text[: len(text) - len(text.lstrip())]
        text = "\n".join(_wrapped(text, wide, indent + "  "))
    sys.stdout.write(text + "\n")


def at_terminal(json_file: str | None) -> bool:
    """Return whether somebody can be asked: at a terminal whose output is not taken by the answer."""
    return json_file != "-" and sys.stdin.isatty() and sys.stdout.isatty()


def _known_width() -> int:
    """Return the width of the terminal, or the one that COLUMNS states; 0 in a pipe."""
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    return shutil.get_terminal_size((0, 0)).columns if known else 0


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], note: str = "") -> None:
    """Print a table; numbers are aligned to the right and never cut, None is a dash."""
    # In a pipe there is nothing to fit.
    wide = _known_width() or 200
    bold = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    head = [f"\x1b[1m{line}\x1b[0m" if bold else line for line in _wrapped(title, wide)]
    foot = _wrapped(note, wide) if note else []
    sys.stdout.write("\n".join([*head, "", *table_lines(columns, rows, wide), "", *foot]) + "\n")


def table_lines(columns: Sequence[str], rows: Sequence[Sequence[Any]], wide: int) -> list[str]:
    """Lay a table out in so many characters.

    Where they do not hold all columns, each row becomes a paragraph with the column's name before every value.
    """
    cells = [[shown(x) for x in row] for row in rows]
    numeric = [
        all(row[i] is None or isinstance(row[i], int | float) or _NUMBERS.fullmatch(row[i]) for row in rows)
        for i in range(len(columns))
    ]
    widths = _widths(columns, cells, numeric, wide - _INDENT)
    if widths is None:
        return _paragraphs(columns, cells, numeric, wide)
    rule = " " * _INDENT + "─" * (sum(widths) + _GAP * (len(widths) - 1))
    return [*_row(columns, widths, numeric), rule, *(line for row in cells for line in _row(row, widths, numeric))]


def _widths(
    columns: Sequence[str], cells: Sequence[Sequence[str]], numeric: Sequence[bool], room: int
) -> list[int] | None:
    """Return widths of the columns, wrapped between words where they have to be; None where not even that fits."""
    own = [[name, *(row[i] for row in cells)] for i, name in enumerate(columns)]
    widths = [max(map(len, texts)) for texts in own]
    least = [max((len(word) for text in texts for word in text.split()), default=0) for texts in own]
    room -= _GAP * (len(columns) - 1)
    while sum(widths) > room:
        widest = max(range(len(widths)), key=lambda i: widths[i] * (widths[i] > least[i]))
        if widths[widest] == least[widest]:
            return None
        # A vector has all its numbers on one line, or each on its own.
        widths[widest] = least[widest] if numeric[widest] else widths[widest] - 1
    return widths


def _wrapped(text: str, width: int, indent: str = "") -> list[str]:
    if len(text) <= width:
        return [text]
    return textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _aligned(text: str, width: int, numeric: bool) -> str:
    return text.strip().rjust(width) if numeric else text.ljust(width)


def _row(cells: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> list[str]:
    wrapped = [_wrapped(text, width) for text, width in zip(cells, widths, strict=True)]
    lines = (map(_aligned, line, widths, numeric) for line in zip_longest(*wrapped, fillvalue=""))
    return [(" " * _INDENT + (" " * _GAP).join(line)).rstrip() for line in lines]


def _paragraphs(
    columns: Sequence[str], cells: Sequence[Sequence[str]], numeric: Sequence[bool], wide: int
) -> list[str]:
    """Lay rows out as paragraphs: the first cell, then name and value of each other, aligned across rows."""
    widths = [max((len(row[i]) for row in cells), default=0) for i in range(len(columns))]
    lines = []
    for row in cells:
        lines.append(" " * _INDENT + row[0])
        line = ""
        for name, text, width, number in list(zip(columns, row, widths, numeric, strict=True))[1:]:
            field = f"{name} {_aligned(text, width, number)}".lstrip()
            if line and len(line) + _GAP + len(field) > wide:
                lines += _wrapped(line.rstrip(), wide, " " * 3 * _GAP)
                line = ""
            line += " " * (_GAP if line else 2 * _GAP) + (field if text else " " * len(field))
        lines += _wrapped(line.rstrip(), wide, " " * 3 * _GAP)
    return [line for line in lines if line]


def shown(value: Any) -> str:
    """Return one cell of a table."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if not math.isfinite(value):
            return "–"
        return f"{value:.3f}" if abs(value) < 100 else f"{value:.1f}"
    return str(value)


@contextmanager
def progress(text: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal, nothing in a pipe; yields what to call with the fraction done."""
    if not sys.stderr.isatty():
        yield lambda fraction: None
        return
    from rich.console import Console
    from rich.progress import Progress, TextColumn, TimeElapsedColumn

    *done, left = Progress.get_default_columns()
    columns = (*done, TimeElapsedColumn(), TextColumn("left"), left)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=None)

        def update(fraction: float) -> None:
            bar.update(task, total=1.0, completed=fraction)

        yield update
