"""Lines of text: what the first lines tell is kept, what does not fit is refused, and no unit is assumed."""

from __future__ import annotations

import pytest

from daq.drivers.base import Samples
from daq.drivers.text_lines import MOST_LINE_BYTES, TextLines
from daq.errors import DriverError
from tests.daq.drivers.scripted import Scripted

COLUMNS = "t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm"
HEADER = b"t [ms];Fx [N];Fy [N];Fz [N];Tx [Nm];Ty [Nm];Tz [Nm]\r\n"
LINE = b"1500;1,5;-2,25;3;0,01;-0,02;0,5\r\n"
WRENCH = [1.5, -2.25, 3.0, 10.0, -20.0, 500.0]


def fed(data: bytes, **given: str) -> Samples:
    return TextLines(given).decoder().feed(data)


def test_a_header_tells_the_columns_their_units_and_the_delimiter() -> None:
    for data in (HEADER + LINE * 2, b"0;0,1;2\r\n" + HEADER + LINE * 2):
        got = fed(data)
        assert len(got) == 2
        assert got.wrench[1] == pytest.approx(WRENCH)
        assert got.device_s == pytest.approx([1.5, 1.5])
        assert got.rejected == 0


@pytest.mark.parametrize(
    "line",
    [
        b"1.5,2,-3.25,4,5,6,7\n",
        b"1.5, 2.0, -3.25, 4., 5, 6, 7,\r\n",
        b"1.5\t2\t-3.25\t4\t5\t6\t7\r",
        b" 1.5  2 -3.25   4  5 6 7\n",
        b"1,5;2;-3,25;4;5;6;7\r\n",
        b"1,5 2 -3,25 4 5 6 7\r\n",
        b"15e-1,+2,-325E-2,4,.5e1,6,7\n",
    ],
)
def test_delimiter_and_decimal_mark_are_told_by_the_first_lines(line: bytes) -> None:
    got = fed(b"cut off" + line * 4, columns=COLUMNS)
    assert len(got) == 3
    assert got.device_s is not None
    assert got.wrench[0] == pytest.approx([2.0, -3.25, 4.0, 5.0, 6.0, 7.0])
    assert got.device_s[0] == 1.5


@pytest.mark.parametrize(
    "line",
    [
        b"Fx:1.5 Fy:-2.25 Fz:3 Tx:10 Ty:-20.0 Tz:500\r\n",
        b"Fx=1.5,Fy=-2.25,Fz=3,Tx=10,Ty=-20.0,Tz=500\n",
        b"fx: 1,5; fy: -2,25; fz: 3; mx: 10; my: -20,0; mz: 5e2\n",
        b"Fx_N:1.5\tFy_N:-2.25\tFz_N:3.0\tTx_Nmm:10\tTy_Nmm:-20\tTz_Nmm:500\n",
    ],
)
def test_numbers_with_labels_are_read_as_their_columns(line: bytes) -> None:
    got = fed(line * 3, columns="Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm")
    assert (len(got), got.rejected) == (2, 0)
    assert got.wrench[1] == pytest.approx(WRENCH)


def test_labels_with_units_are_the_header() -> None:
    line = b"t_ms:1500 Fx_N:1.5 Fy_N:-2.25 Fz_N:3 Tx_Nm:0.01 Ty_Nm:-0.02 Tz_Nm:0.5\n"
    device = TextLines()
    device.start(Scripted([], then=[line * 3]))
    # A later reader has only what was kept.
    got = TextLines(device.values).decoder().feed(line * 3)
    assert got.wrench[1] == pytest.approx(WRENCH)
    assert got.device_s == pytest.approx([1.5, 1.5])


@pytest.mark.parametrize(
    "line",
    [
        b"Fy:1 Fx:2 Fz:3 Tx:4 Ty:5 Tz:6\n",
        b"Fx:1 Fy:2 Fz:3 Tx:4 Ty:5\n",
        b"Fx:1 Fy:2 Fz:3 Tx:4 Ty:5 Tz:nan\n",
        b"Fx:1 Fy:2 Fz:3 Tx:4 Ty:5 Tz:6 extra:7\n",
    ],
)
def test_labels_that_are_not_those_of_the_columns_are_refused(line: bytes) -> None:
    got = fed(b"\n0,0,0,0,0,0\n" + line, columns="Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm")
    assert (len(got), got.rejected) == (0, 1)


def test_the_first_line_may_be_a_part_and_is_not_used() -> None:
    got = fed(b"34.5,1,2,3,4,5,6\n35.5,1,2,3,4,5,6\n", columns=COLUMNS)
    assert got.device_s == pytest.approx([35.5])
    assert got.skipped == len("34.5,1,2,3,4,5,6")
    assert got.rejected == 0


def test_without_a_time_arrivals_tell_it() -> None:
    got = fed(b"\n0,0,0,0,0,0\n1,2,3,4,5,6,0\n1,2,3,4,5,6\n", columns="Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm")
    assert got.device_s is None
    # An empty line is none, so the first one that says something is left out.
    assert got.wrench.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]
    assert got.rejected == 1


def test_status_and_columns_that_nobody_asked_for() -> None:
    columns = "count,Fz_N,Fy_N,Fx_N,Tx_Nmm,Ty_Nmm,Tz_Nmm,status"
    got = fed(b"\nx\n9,3,2,1,4,5,6,0\n9,3,2,1,4,5,6,7\n9,3,2,1,4,5,6,7.5\n9,3,2,1,4,5,6,1e300\n", columns=columns)
    assert got.wrench[0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert got.status.tolist() == [0, 7]
    assert got.rejected == 2


@pytest.mark.parametrize(
    "bad",
    [
        b"1,2,3,4,5,6",
        b"1,2,3,4,5,6,7,8",
        b"1,2,3,4,nan,6,7",
        b"1,2,3,4,1e200,6,7",
        b"1,2,3,4,1e999,6,7",
        b"1,2,3,4,1_0,6,7",
        b"1,2,3,4,,6,7",
        b"1;2;3;4;5;6;7",
        b"1,2,3,4,0x1,6,7",
        b"1,2,3,4,5,6,\x007",
        "1,2,3,4,5,6,٧".encode(),
        b"# remark",
        b"1," + b" " * MOST_LINE_BYTES + b"2,3,4,5,6,7",
    ],
)
def test_a_line_that_does_not_fit_is_counted_and_the_next_is_read(bad: bytes) -> None:
    good = b"1.0,2,3,4,5,6,7\n"
    got = fed(good * 2 + bad + b"\n" + good, columns=COLUMNS)
    assert len(got) == 2
    assert got.rejected == 1


def test_the_decimal_mark_is_kept_once_one_was_seen() -> None:
    decoder = TextLines({"columns": COLUMNS}).decoder()
    got = decoder.feed(b"x\n1;2;3;4;5;6;7\n1,5;2;3;4;5;6;7\n1.5;2;3;4;5;6;7\n")
    assert got.device_s == pytest.approx([1.0, 1.5])
    assert got.rejected == 1
    assert (decoder.delimiter, decoder.decimal) == ("semicolon", "comma")


def test_a_header_later_on_that_says_otherwise_ends_the_readings_until_it_is_taken_back() -> None:
    decoder = TextLines().decoder()
    assert len(decoder.feed(HEADER + LINE + HEADER + LINE)) == 2
    other = decoder.feed(HEADER.replace(b"Fx [N]", b"Fx [lbf]") + LINE * 3)
    assert (len(other), other.rejected) == (0, 3)
    assert len(decoder.feed(HEADER + LINE)) == 1


def test_a_header_that_was_cut_off_is_no_header_for_longer_lines() -> None:
    got = fed(HEADER.removeprefix(b"t [ms];") + LINE * 3)
    assert (len(got), got.rejected) == (0, 3)


def test_a_line_without_end_is_not_kept() -> None:
    decoder = TextLines({"columns": COLUMNS}).decoder()
    decoder.feed(b"\n0\n")
    got = [decoder.feed(b"7" * 1000) for _ in range(50)]
    assert sum(s.skipped for s in got) > 48_000
    assert len(decoder._held) <= MOST_LINE_BYTES
    got.append(decoder.feed(b"\n1,2,3,4,5,6,7\n"))
    assert sum(s.skipped for s in got) == 50_000
    assert (len(got[-1]), got[-1].rejected) == (1, 1)


def test_what_the_start_learns_is_kept_for_later_decoders_and_the_record() -> None:
    cell = TextLines()
    link = Scripted([], then=[b"Load cell 2.1\r\n", HEADER, LINE[:9], LINE[9:], LINE])
    cell.start(link)
    link.close()
    assert cell.values["delimiter"] == "semicolon"
    assert cell.values["decimal"] == "comma"
    got = TextLines(cell.values).decoder().feed(LINE[4:] + LINE)
    assert got.wrench[0] == pytest.approx(WRENCH)
    assert got.device_s == pytest.approx([1.5])


@pytest.mark.parametrize(
    ("says", "given", "said"),
    [
        (b"", {}, "sends nothing"),
        (b"1,2,3,4,5,6,7\n" * 40, {}, "'1,2,3,4,5,6,7', without a header; expected .* the setting columns"),
        (b"1,2,3\n" * 40, {"columns": COLUMNS}, "'1,2,3'; expected numbers for the columns t_s,Fx_N"),
        (b"Fx:1 Fy:2 Fz:3 Tx:4 Ty:5 Tz:6\n" * 40, {}, "column 'Fx' states no unit"),
        (b"t_s,Fx,Fy,Fz,Tx,Ty,Tz\n" + b"1,2,3,4,5,6,7\n" * 40, {}, "column 'Fx' states no unit"),
        (b"t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm\n" + b"1,2,3,4,5,6\n" * 40, {}, "lacks column Tz_Nmm"),
    ],
)
def test_why_a_device_cannot_be_read_is_said(says: bytes, given: dict[str, str], said: str) -> None:
    with pytest.raises(DriverError, match=said) as caught:
        TextLines(given).start(Scripted([], then=[says]))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"columns": "t_s,Fx,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm"}, "states no unit"),
        ({"columns": COLUMNS.replace("Nmm", "furlong")}, "not a unit of torque"),
        ({"columns": "t_s,Fx_N"}, "lacks columns Fy_N"),
        ({"columns": COLUMNS, "delimiter": "comma", "decimal": "comma"}, "both delimiter and decimal mark"),
    ],
)
def test_columns_that_cannot_be_used_are_refused(given: dict[str, str], said: str) -> None:
    with pytest.raises(DriverError, match=said):
        TextLines(given)
