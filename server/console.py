"""What the command line prints: JSON answers, tables, progress, and one clear line for bad input."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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
    from rich.console import Console

    Console(highlight=False, soft_wrap=True).print(text, markup=False)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], note: str = "") -> None:
    """Print a table; numbers are aligned to the right, None is a dash."""
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    out = Table(
        title=escape(title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, caption=escape(note)
    )
    out.caption_justify = "left"
    for i, name in enumerate(columns):
        numeric = all(isinstance(row[i], int | float) or row[i] is None for row in rows)
        out.add_column(escape(name), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        out.add_row(*(escape(shown(x)) for x in row))
    # In a pipe there is no width to fit: let lines be as long as they are.
    console = Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=200)
    console.print(out)


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
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=None)

        def update(fraction: float) -> None:
            bar.update(task, total=1.0, completed=fraction)

        yield update
