"""What the command line prints: JSON answers, tables, progress, and one clear line for bad input."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.files import replacing


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


def clean(value: Any) -> Any:
    """Return plain JSON: NumPy numbers as numbers, NaN and infinities as null."""
    if isinstance(value, dict):
        return {str(k): clean(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [clean(v) for v in value]
    if hasattr(value, "tolist"):
        return clean(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def say(text: str = "") -> None:
    """Print one line of plain text."""
    sys.stdout.write(text + "\n")


def columns_wide() -> int:
    """Width that tables may take: the terminal's, or 200 in a pipe, where there is nothing to fit."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else 200


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], note: str = "") -> None:
    """Print a table; numbers are aligned to the right and never broken, None is a dash."""
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    out = Table(title=escape(title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    out.caption, out.caption_justify = escape(note), "left"
    for i, name in enumerate(columns):
        cells = [row[i] for row in rows]
        numeric = all(isinstance(x, int | float) or x is None for x in cells)
        # Numbers in text (a vector, a mass with its tendon) are kept whole too.
        whole = numeric or all(re.fullmatch(r"[\s\d.+-]*", str(x)) for x in cells)
        longest_word = max((len(word) for word in name.split()), default=1)
        out.add_column(
            escape(name),
            justify="right" if numeric else "left",
            overflow="fold",
            no_wrap=whole and not name.count(" "),
            min_width=max([longest_word, *(len(shown(x)) for x in cells)]) if whole else longest_word,
        )
    for row in rows:
        out.add_row(*(escape(shown(x)) for x in row))
    buffer = StringIO()
    colour = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    Console(file=buffer, highlight=False, width=columns_wide(), force_terminal=colour).print(out)
    sys.stdout.write("\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n")


def shown(value: Any) -> str:
    """One cell of a table."""
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
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=None)

        def update(fraction: float) -> None:
            bar.update(task, total=1.0, completed=fraction)

        yield update
