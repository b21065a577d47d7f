"""Write a table for colleagues who work in a spreadsheet: an Excel file that says what its columns are."""

from __future__ import annotations

import datetime as dt
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.export.tables import DEFUSED, defused, describe_columns
from daq.files import replacing

# Of a sheet, and of one cell's text.
MOST_ROWS, MOST_TEXT = 1_048_575, 32_767
# The same table gives the same bytes.
_CREATED = dt.datetime(2000, 1, 1)  # noqa: DTZ001 (a spreadsheet's times have no zone)
_WIDEST = 40


def write_excel(columns: Mapping[str, list[Any]], file: Path, about: Mapping[str, Any]) -> None:
    """Write columns as the sheets `table`, `columns` (unit, frame and meaning of each) and `about`.

    Numbers are numbers, in full; what is unknown is an empty cell. No text is a formula or a link, and one that would
    become a formula as soon as somebody edits its cell has an apostrophe before it.

    Args:
        columns: of one length.
        file: of the table.
        about: what else it says, such as session, software and sources.

    Raises:
        InputError: there is no row, or more than a sheet holds.
    """
    import xlsxwriter
    from xlsxwriter.exceptions import FileCreateError

    count = len(next(iter(columns.values()), []))
    if not 0 < count <= MOST_ROWS:
        raise InputError(f"{count} rows to export", f"1 to {MOST_ROWS}, which a sheet holds", "Use --format parquet")
    options = {"strings_to_formulas": False, "strings_to_urls": False, "strings_to_numbers": False}
    with replacing(file) as temporary:
        temporary.touch()  # so that a folder that cannot be written to is said in the system's words
        book = xlsxwriter.Workbook(str(temporary), options)
        book.set_properties({"created": _CREATED, "comments": str(about.get("software", ""))})
        bold = book.add_format({"bold": True})
        _sheet(book.add_worksheet("table"), columns, bold)
        described = describe_columns(list(columns))
        _sheet(book.add_worksheet("columns"), {key: [d[key] for d in described] for key in described[0]}, bold)
        facts = {"texts": DEFUSED, **about}
        said = [v if isinstance(v, str) else json.dumps(v, ensure_ascii=False) for v in facts.values()]
        _sheet(book.add_worksheet("about"), {"what": list(facts), "is": said}, bold)
        try:
            book.close()
        except FileCreateError as error:  # it hides the system's error within its own
            reason = error.args[0] if error.args and isinstance(error.args[0], OSError) else OSError(str(error))
            raise reason from error


def _sheet(sheet: Any, columns: Mapping[str, list[Any]], bold: Any) -> None:
    for at, (name, values) in enumerate(columns.items()):
        sheet.write_string(0, at, str(defused(name)), bold)
        for row, value in enumerate(values, 1):
            _cell(sheet, row, at, value)
        widest = max(len(name), *(len(v) if isinstance(v, str) else 0 for v in values))
        sheet.set_column(at, at, min(widest + 2, _WIDEST))
    sheet.freeze_panes(1, 0)
    sheet.autofilter(0, 0, max(map(len, columns.values())), len(columns) - 1)


def _cell(sheet: Any, row: int, at: int, value: Any) -> None:
    if isinstance(value, bool):
        sheet.write_boolean(row, at, value)
    elif isinstance(value, str):
        sheet.write_string(row, at, defused(value)[:MOST_TEXT])
    elif value is not None and math.isfinite(value):
        sheet.write_number(row, at, value)
