from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import ReadingsError
from daq.recordings.readings import HEADERS, ReadingBlock, open_readings, write_readings
from tests.daq.benches import in_blocks

HEADER = ",".join(HEADERS)
ROW = "0.01,1,2,3,4,5,6"


def text_file(folder: Path, text: str, name: str = "readings.csv") -> Path:
    path = folder / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return path


def together(path: Path) -> ReadingBlock:
    blocks = list(open_readings(path).blocks())
    status = [b.status for b in blocks if b.status is not None]
    return ReadingBlock(
        np.concatenate([b.t_s for b in blocks]),
        np.concatenate([b.wrench for b in blocks]),
        np.concatenate(status) if status else None,
    )


def some(n: int, seed: int = 0, status: bool = False) -> ReadingBlock:
    rng = np.random.default_rng(seed)
    flags = rng.integers(0, 2**31, n) if status else None
    return ReadingBlock(np.cumsum(rng.uniform(0.001, 0.1, n)), rng.normal(scale=10.0, size=(n, 6)), flags)


@pytest.mark.parametrize("ending", [".csv", ".csv.gz", ".parquet"])
@pytest.mark.parametrize("status", [False, True])
def test_what_is_written_is_read_to_the_last_bit(ending: str, status: bool, tmp_path: Path) -> None:
    block = some(1000, status=status)
    path = write_readings(tmp_path / f"r{ending}", in_blocks(block, 37))
    again = together(path)
    np.testing.assert_array_equal(again.t_s, block.t_s)
    np.testing.assert_array_equal(again.wrench, block.wrench)
    if status:
        np.testing.assert_array_equal(again.status, block.status)
    else:
        assert again.status is None
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_long_file_arrives_in_blocks(tmp_path: Path) -> None:
    block = some(100_000)
    for ending in (".csv", ".csv.gz", ".parquet"):
        path = write_readings(tmp_path / f"r{ending}", [block])
        blocks = list(open_readings(path).blocks())
        assert len(blocks) > 2
        assert max(len(b) for b in blocks) < 50_000
        np.testing.assert_array_equal(np.concatenate([b.wrench for b in blocks]), block.wrench)


def test_members_of_a_gzip_are_read_one_after_another(tmp_path: Path) -> None:
    path = tmp_path / "r.csv.gz"
    path.write_bytes(gzip.compress(f"{HEADER}\n{ROW}\n".encode()) + gzip.compress(b"0.02,1,2,3,4,5,6\n"))
    assert together(path).t_s.tolist() == [0.01, 0.02]


def test_content_tells_the_format_not_the_name(tmp_path: Path) -> None:
    path = write_readings(tmp_path / "r.parquet", [some(10)])
    assert together(path.rename(tmp_path / "r.csv")).wrench.shape == (10, 6)


@given(st.permutations(range(7)))
@settings(max_examples=20)
def test_columns_in_any_order(order: list[int]) -> None:
    import tempfile

    headers, values = list(HEADERS), ["0.5", "1", "2", "3", "4", "5", "6"]
    with tempfile.TemporaryDirectory() as folder:
        text = ",".join(headers[i] for i in order) + "\n" + ",".join(values[i] for i in order) + "\n"
        block = together(text_file(Path(folder), text))
    assert block.t_s.tolist() == [0.5]
    assert block.wrench.tolist() == [[1, 2, 3, 4, 5, 6]]


@pytest.mark.parametrize(
    ("header", "factor", "column"),
    [
        ("Fx_lbf", 4.4482216152605, 0),
        ("Fx (N)", 1.0, 0),
        ("Fx[N]", 1.0, 0),
        ("Fx [mN]", 1e-3, 0),
        ("FX_kN", 1e3, 0),
        ("Fx_kgf", 9.80665, 0),
        ("Fx_kg", 9.80665, 0),
        ("Fx/N", 1.0, 0),
        ("Tx_Nm", 1e3, 3),
        ("Tx (N m)", 1e3, 3),
        ("Tx [N·m]", 1e3, 3),
        ("Mx_N_mm", 1.0, 3),
        ("Tx_mNm", 1.0, 3),
        ("Tx_lbf_in", 112.9848290276167, 3),
        ("Tx (lbf-ft)", 1355.8179483314, 3),
        ("t_ms", 1e-3, -1),
        ("t [us]", 1e-6, -1),
        ("Time (min)", 60.0, -1),
    ],
)
def test_units_are_converted_and_reported(header: str, factor: float, column: int, tmp_path: Path) -> None:
    headers = [header if i == column + 1 else h for i, h in enumerate(HEADERS)]
    path = text_file(tmp_path, ",".join(headers) + "\n2,2,2,2,2,2,2\n")
    source = open_readings(path)
    block = next(source.blocks())
    value = block.t_s[0] if column < 0 else block.wrench[0, column]
    assert value == pytest.approx(2.0 * factor, rel=1e-12)
    assert bool(source.conversions) == (factor != 1.0)
    if factor != 1.0:
        assert header in source.conversions[0]
        assert HEADERS[column + 1] in source.conversions[0]


BAD_FILES: dict[str, tuple[str, list[str]]] = {
    "empty": ("", ["is empty", HEADER]),
    "blank": ("\n\n", ["line 1", "is empty"]),
    "header only": (f"{HEADER}\n", ["no readings"]),
    "header without newline": (HEADER, ["no readings"]),
    "no header": (f"{ROW}\n{ROW}\n", ["line 1", "header"]),
    "missing": ("t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm\n1,2,3,4,5,6\n", ["lacks column Tz_Nmm"]),
    "missing two": ("t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm\n1,2,3,4,5\n", ["lacks columns Ty_Nmm, Tz_Nmm"]),
    "twice": (f"{HEADER},Fx_N\n{ROW},1\n", ["Fx twice"]),
    "two units": (f"{HEADER},Fx_lbf\n{ROW},1\n", ["Fx twice", "Fx_lbf"]),
    "no unit": (f"{HEADER.replace('Fx_N', 'Fx')}\n{ROW}\n", ["'Fx' states no unit", "never assumed"]),
    "unknown unit": (f"{HEADER.replace('Fx_N', 'Fx_V')}\n{ROW}\n", ["'Fx_V' is in 'V'", "not a unit of force"]),
    "torque in newton": (f"{HEADER.replace('Tx_Nmm', 'Tx_N')}\n{ROW}\n", ["'Tx_N'", "not a unit of torque"]),
    "not a number": (f"{HEADER}\n{ROW}\n0.02,1,2,abc,4,5,6\n", ["row 2 (line 3)", "column Fz_N is 'abc'"]),
    "a number of Python's": (f"{HEADER}\n{ROW}\n0.02,1,2,2_1,4,5,6\n", ["row 2 (line 3)", "column Fz_N is '2_1'"]),
    "nan": (
        f"{HEADER}\n{ROW}\n0.02,1,nan,3,4,5,6\n",
        ["row 2 (line 3)", "column Fy_N is 'nan'", "finite", "Remove the row"],
    ),
    "more than a cell tells": (
        f"{HEADER}\n{ROW}\n0.02,1,2,3,4,1e200,6\n",
        ["row 2 (line 3)", "column Ty_Nmm is '1e200'", "a number that a load cell can tell, within ±1e+12"],
    ),
    "inf": (f"{HEADER}\n0.01,1,2,3,4,5,-inf\n", ["row 1 (line 2)", "column Tz_Nmm is '-inf'"]),
    "hole": (f"{HEADER}\n{ROW}\n0.02,1,,3,4,5,6\n", ["row 2 (line 3)", "column Fy_N is ''"]),
    "torn row": (f"{HEADER}\n{ROW}\n0.02,1,2\n", ["row 2 (line 3) has 3 fields", "7"]),
    "decimal comma": (f"{HEADER}\n0,01,1,0,2,0,3,0,4,0,5,0,6,0\n", ["row 1", "14 fields", "Decimal commas?"]),
    "quoted comma": (f'{HEADER}\n"0,01",1,2,3,4,5,6\n', ["row 1", "t_s is '0,01'", "decimal point"]),
    "semicolons": (f"{HEADER.replace(',', ';')}\n{ROW.replace(',', ';')}\n", ["semicolons", "commas"]),
    "tabs": (HEADER.replace(",", "\t") + "\n", ["tabs"]),
    "status": (f"{HEADER},status\n{ROW},broken\n", ["status 'broken'"]),
}


@pytest.mark.parametrize("ending", ["readings.csv", "readings.csv.gz"])
@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files_are_one_clear_line(name: str, ending: str, tmp_path: Path) -> None:
    text, words = BAD_FILES[name]
    path = text_file(tmp_path, text, ending)
    with pytest.raises(ReadingsError) as caught:
        list(open_readings(path).blocks())
    line = str(caught.value)
    assert "\n" not in line
    if name == "empty" and ending.endswith(".gz"):
        words = ["line 1", "is empty"]
    for word in words:
        assert word in line


def test_a_fault_late_in_a_long_file_is_placed(tmp_path: Path) -> None:
    rows = [f"{i / 1000},1,2,3,4,5,6" for i in range(60_000)]
    rows[55_000] = "55.0,1,2,3,4,nan,6"
    path = text_file(tmp_path, HEADER + "\n" + "\n".join(rows))
    with pytest.raises(ReadingsError, match=r"row 55001 \(line 55002\), column Ty_Nmm is 'nan'"):
        list(open_readings(path).blocks())


def test_more_than_a_cell_tells_is_placed_in_parquet_and_after_conversion(tmp_path: Path) -> None:
    block = some(50_000)
    block.wrench[40_000, 2] = -1e200
    path = write_readings(tmp_path / "r.parquet", [block])
    with pytest.raises(ReadingsError, match=r"row 40001, column Fz_N is -1e\+200; expected a number that a load cell"):
        list(open_readings(path).blocks())
    path = tmp_path / "r.csv"
    path.write_text("t_s,Fx_kN,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm\n1e13,2e10,2,3,4,5,6\n", encoding="utf-8")
    with pytest.raises(ReadingsError, match=r"row 1 \(line 2\), column Fx_kN is '2e10'; expected a number that"):
        list(open_readings(path).blocks())


def test_nan_in_parquet_is_placed(tmp_path: Path) -> None:
    block = some(50_000)
    block.wrench[40_000, 2] = np.nan
    path = write_readings(tmp_path / "r.parquet", [block])
    with pytest.raises(ReadingsError, match="row 40001, column Fz_N is nan"):
        list(open_readings(path).blocks())


def test_text_and_nulls_in_parquet(tmp_path: Path) -> None:
    columns = {h: pa.array([1.0, 2.0]) for h in HEADERS}
    pa.parquet.write_table(pa.table({**columns, "Fx_N": pa.array(["a", "b"])}), tmp_path / "text.parquet")
    with pytest.raises(ReadingsError, match="'Fx_N' holds string"):
        list(open_readings(tmp_path / "text.parquet").blocks())
    pa.parquet.write_table(pa.table({**columns, "Fx_N": pa.array([1.0, None])}), tmp_path / "null.parquet")
    with pytest.raises(ReadingsError, match="row 2, column Fx_N"):
        list(open_readings(tmp_path / "null.parquet").blocks())
    whole = {h: pa.array([1, 2], pa.int32()) for h in HEADERS}
    pa.parquet.write_table(pa.table(whole), tmp_path / "whole.parquet")
    assert together(tmp_path / "whole.parquet").t_s.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("ending", [".csv.gz", ".parquet"])
@pytest.mark.parametrize("share", [0.3, 0.9, 0.999])
def test_a_file_cut_off_is_damaged(ending: str, share: float, tmp_path: Path) -> None:
    path = write_readings(tmp_path / f"r{ending}", [some(20_000)])
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ReadingsError, match="torn or damaged"):
        list(open_readings(path).blocks())


def test_a_flipped_byte_in_a_gzip_is_damage(tmp_path: Path) -> None:
    path = write_readings(tmp_path / "r.csv.gz", [some(20_000)])
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(ReadingsError):
        list(open_readings(path).blocks())


def test_an_absent_file(tmp_path: Path) -> None:
    with pytest.raises(ReadingsError, match=r"nothing\.csv cannot be read"):
        open_readings(tmp_path / "nothing.csv")


def test_other_columns_are_noted(tmp_path: Path) -> None:
    path = text_file(tmp_path, f"{HEADER},temperature_C,status\n{ROW},21.5,0x80000005\n")
    source = open_readings(path)
    assert source.notes == ("column 'temperature_C' is not used",)
    block = next(source.blocks())
    assert block.status is not None
    assert block.status.tolist() == [0x80000005]


def test_byte_order_mark_and_windows_lines(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_bytes(b"\xef\xbb\xbf" + f"{HEADER}\r\n{ROW}\r\n\r\n".encode())
    assert together(path).wrench.tolist() == [[1, 2, 3, 4, 5, 6]]


def test_nothing_is_left_of_a_write_that_failed(tmp_path: Path) -> None:
    def blocks() -> Iterator[ReadingBlock]:
        yield some(10)
        raise RuntimeError("the bench lost power")

    with pytest.raises(RuntimeError):
        write_readings(tmp_path / "r.parquet", blocks())
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ReadingsError, match=r"\.csv, \.csv\.gz or \.parquet"):
        write_readings(tmp_path / "r.xlsx", [])
    with pytest.raises(ReadingsError, match="only some"):
        write_readings(tmp_path / "r.csv", [some(3), some(3, status=True)])


pieces = st.sampled_from(
    [HEADER, ROW, "\n", ",", ";", "0.5", "nan", "x", '"', "\r", "Fx_N", "t_s", "\x00", " ", "é", "-", "1e999"]
)


@given(st.lists(pieces, max_size=30).map("".join) | st.binary(max_size=200), st.booleans())
@settings(max_examples=150, deadline=None)
def test_no_file_whatsoever_gives_another_exception(content: str | bytes, zipped: bool) -> None:
    import tempfile

    raw = content.encode() if isinstance(content, str) else content
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.csv"
        path.write_bytes(gzip.compress(raw) if zipped else raw)
        line = ""
        try:
            list(open_readings(path).blocks())
        except ReadingsError as error:
            line = str(error)
        assert "\n" not in line


@pytest.mark.parametrize("name", ["r.csv", "r.csv.gz", "r.parquet"])
def test_blocks_stay_small_however_long_the_file(name: str, tmp_path: Path) -> None:
    n = 100_000
    long = ReadingBlock(np.arange(n) / 1000.0, np.tile(np.arange(6.0), (n, 1)))
    write_readings(tmp_path / name, [long])
    sizes = [len(block) for block in open_readings(tmp_path / name).blocks()]
    assert sum(sizes) == n
    assert max(sizes) <= 1 << 16


@given(
    st.lists(st.sampled_from([ROW, f" {ROW}", "", ROW.replace("1", "1e0", 1)]), max_size=12),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["0.02,1,2,abc,4,5,6", "0.02,1,2", "0.02,1,2,,4,5,6"]),
    st.booleans(),
)
@settings(deadline=None, max_examples=40)
def test_the_place_of_a_fault_hangs_on_no_start(lines: list[str], end: str, bad: str, zipped: bool) -> None:
    from daq.recordings.files import _first_fault

    with TemporaryDirectory() as folder:
        file = Path(folder) / "readings.csv"
        text = end.join([HEADER, *lines, bad, ROW, ""]).encode()
        file.write_bytes(gzip.compress(text) if zipped else text)
        source = open_readings(file)
        whole = str(_first_fault(source, 0))
        sound = [line for line in lines if line]
        assert {str(_first_fault(source, k)) for k in range(len(sound) + 1)} == {whole}


def test_a_line_end_inside_quotes_does_not_shift_the_place(tmp_path: Path) -> None:
    from daq.recordings.files import _first_fault

    file = tmp_path / "readings.csv"
    file.write_text(f'{HEADER},note\n{ROW},"a\nb"\n{ROW},c\n0.03,1,2,abc,4,5,6,d\n', encoding="utf-8")
    source = open_readings(file)
    assert str(_first_fault(source, 2)) == str(_first_fault(source, 0))
    assert "row 3 (line 5)" in str(_first_fault(source, 2))
