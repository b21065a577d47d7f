"""What is exported opens in the programs that colleagues have."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pandas as pd
import polars as pl
import pytest

from daq.errors import InputError
from daq.export import excel as export_excel
from daq.export.excel import write_excel
from daq.export.tables import case_columns, describe_columns, write_columns
from daq.sessions import read_session
from daq.signals.corrections import measure

ABOUT = {"software": "fingertwin 9", "sources": {"readings.csv": "ab"}, "notes": []}


@pytest.fixture(scope="module")
def columns() -> dict[str, list[Any]]:
    return dict(case_columns(measure(read_session("synek2019_H01"))))


def same(frame: Any, columns: dict[str, list[Any]]) -> None:
    """A table with every number, text and gap of the columns."""
    assert list(frame.columns) == list(columns)
    for name, values in columns.items():
        read = [None if v is None or v != v else v for v in list(frame[name])]  # noqa: PLR0124 (NaN)
        numbers = [v for v in values if isinstance(v, float)]
        if numbers:
            assert [v is None for v in read] == [v is None for v in values], name
            np.testing.assert_array_equal([v for v in read if v is not None], numbers, err_msg=name)
        else:
            assert read == values, name


def test_pandas_and_polars_open_csv_and_parquet(columns: dict[str, list[Any]], tmp_path: Path) -> None:
    table, parquet = tmp_path / "cases.csv", tmp_path / "cases.parquet"
    write_columns(columns, table, "csv")
    write_columns(columns, parquet, "parquet")
    for frame in (pd.read_csv(table), pd.read_parquet(parquet), pl.read_csv(table), pl.read_parquet(parquet)):
        same(frame, columns)


def test_pandas_opens_the_excel_table_with_what_it_means(columns: dict[str, list[Any]], tmp_path: Path) -> None:
    file = tmp_path / "cases.xlsx"
    write_excel(columns, file, ABOUT)
    sheets = pd.read_excel(file, sheet_name=None, engine="calamine")
    assert list(sheets) == ["table", "columns", "about"]
    same(sheets["table"], columns)
    described = describe_columns(list(columns))
    assert list(sheets["columns"]["name"]) == [d["name"] for d in described]
    assert dict(zip(sheets["columns"]["name"], sheets["columns"]["unit"], strict=True))["Fx_N"] == "N"
    about = dict(zip(sheets["about"]["what"], sheets["about"]["is"], strict=True))
    assert (about["software"], about["sources"]) == ("fingertwin 9", '{"readings.csv": "ab"}')
    assert [p.name for p in tmp_path.iterdir()] == ["cases.xlsx"]
    again = tmp_path / "again.xlsx"
    write_excel(columns, again, ABOUT)
    assert again.read_bytes() == file.read_bytes()


def test_no_text_of_an_excel_table_is_a_formula_or_a_link(tmp_path: Path) -> None:
    texts = [
        "=1+1",
        "+A1",
        "-A1",
        "@SUM(A1)",
        '=HYPERLINK("http://x.example")',
        "http://x.example",
        "{=A1}",
        "12",
        "hook",
        "",
    ]
    file = tmp_path / "t.xlsx"
    write_excel(
        {"id": list(texts), "ok": [True] * 9 + [None], "=2+2_N": [-1.0] * 9 + [float("nan")]}, file, {"x": "=3"}
    )
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name).decode() for name in archive.namelist() if name.endswith((".xml", ".rels"))}
    assert not [name for name, text in parts.items() if "<f>" in text or "<f " in text or "hyperlink" in text]
    read = pd.read_excel(file, engine="calamine", dtype={"id": str}, keep_default_na=False)
    assert list(read["id"]) == [f"'{t}" for t in texts[:5]] + texts[5:]
    assert read["'=2+2_N"][0] == -1.0
    assert read["'=2+2_N"][9] == ""


def test_what_a_sheet_cannot_hold_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export_excel, "MOST_ROWS", 2)
    for rows in (0, 3):
        with pytest.raises(InputError, match=f"{rows} rows to export"):
            write_excel({"id": ["a"] * rows}, tmp_path / "t.xlsx", {})
    import xlsxwriter

    def full(_: Any) -> NoReturn:
        raise xlsxwriter.exceptions.FileCreateError(OSError(28, "No space left on device"))

    monkeypatch.setattr(xlsxwriter.Workbook, "close", full)
    with pytest.raises(OSError, match="No space left"):
        write_excel({"id": ["a"]}, tmp_path / "t.xlsx", {})
    assert list(tmp_path.iterdir()) == []
