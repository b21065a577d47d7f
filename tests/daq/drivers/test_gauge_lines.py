"""Gauge voltages as text: lines become wrenches, and damage costs the lines that it touches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daq.drivers.base import Samples
from daq.drivers.gauge_lines import LONGEST_LINE, GaugeLines, GaugeLinesDecoder
from daq.errors import DriverError
from tests.daq.cal_files import nano17, numbers, write_cal
from tests.daq.drivers.scripted import Scripted

LINE = b"1.0,0,0,0,0,-2.0\r\n"
WRENCH = [-13.2648, 7.30188, 7.69369, 43.59016, 33.16228, -56.50161]


@pytest.fixture(scope="module")
def cal(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(nano17(tmp_path_factory.mktemp("cal")))


def decoder(cal: str, **more: float | str) -> GaugeLinesDecoder:
    return GaugeLines({"calibration": cal, **more}).decoder()


def together(parts: list[Samples]) -> tuple[list[list[float]], int, int]:
    wrench = np.concatenate([p.wrench for p in parts]).tolist()
    return wrench, sum(p.rejected for p in parts), sum(p.skipped for p in parts)


def test_a_line_becomes_a_wrench(cal: str) -> None:
    got = decoder(cal).feed(b"9,-2.0\r\n" + LINE)
    assert got.wrench[0] == pytest.approx(WRENCH)
    assert (len(got), got.rejected, got.skipped) == (1, 0, 7)
    assert not got.overload.any()


@pytest.mark.parametrize(
    ("line", "more"),
    [
        (b"1.0;0;0;0;0;-2.0\n", {}),
        (b"1.0\t0\t0\t0\t0\t-2.0\r", {}),
        (b"  1e0  0.0  .0 -0  +0, -2.  \n", {}),
        (b"1,0;0,0;0;0;0;-2,0\n", {"decimal": "comma"}),
        (b"1,0 0,0 0 0 0 -2,0\n", {"decimal": "comma"}),
        (b"1000 0 0 0 0 -2000\n", {"volts_per_unit": 0.001, "limit_V": 9.5}),
        (b"17,0.123,1.0,0,0,0,0,-2.0,x\n", {"columns": 9, "first_gauge": 3}),
        (b"1.5,0,0,0,0,-2.0\n", {"zero_V": "0.5 0 0 0 0 0"}),
    ],
)
def test_the_ways_of_writing_it(cal: str, line: bytes, more: dict[str, float | str]) -> None:
    got = decoder(cal, **more).feed(b"\n" + line)
    assert len(got) == 1
    assert got.wrench[0] == pytest.approx(WRENCH)


@pytest.mark.parametrize(
    "line",
    [
        b"Gauge1,Gauge2,G3,G4,G5,G6",
        b"1,0,0,0,0",
        b"1,0,0,0,0,-2,0",
        b"1,0,,0,0,-2",
        b"nan,0,0,0,0,0",
        b"inf,0,0,0,0,0",
        b"1e999,0,0,0,0,0",
        b"1_0,0,0,0,0,0",
        b"0x1,0,0,0,0,0",
        b"1.0 V,0,0,0,0,0",
        b"1.02.0,0,0,0,0,0",
        b"101,0,0,0,0,0",
        b"\xff\xfe,0,0,0,0,0",
        b"\xd9\xa1,0,0,0,0,0",
    ],
)
def test_what_is_no_reading_is_counted(cal: str, line: bytes) -> None:
    got = decoder(cal).feed(b"\n" + LINE + line + b"\r\n" + LINE)
    assert len(got) == 2
    assert got.rejected == 1


def test_a_decimal_point_where_commas_were_said_is_no_reading(cal: str) -> None:
    got = decoder(cal, decimal="comma").feed(b"\n1.5;0;0;0;0;0\n")
    assert (len(got), got.rejected) == (0, 1)


def test_a_gauge_at_its_limit_is_an_overload(cal: str) -> None:
    lines = b"\n9.98,0,0,0,0,0\n9.9951,0,0,0,0,0\n0,0,-10.2,0,0,10\n"
    got = decoder(cal).feed(lines)
    assert got.overload.tolist() == [False, True, True]
    assert got.status.tolist() == [0, 1, 0b100100]
    assert decoder(cal, limit_V=5.0).feed(lines).overload.all()


def test_a_saturated_gauge_is_seen_before_the_zero_is_taken_off(cal: str) -> None:
    got = decoder(cal, zero_V="9 0 0 0 0 0").feed(b"\n9.9999,0,0,0,0,0\n")
    assert got.overload.tolist() == [True]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.one_of(
            st.just(LINE),
            st.just(b"0.1,0.2,0.3,0.4,0.5,0.6\n"),
            st.binary(max_size=40),
            st.just(b"7" * (LONGEST_LINE + 40)),
            st.just(b" " * LONGEST_LINE + b"\n"),
        ),
        max_size=12,
    ),
    st.data(),
)
def test_portions_change_nothing(cal: str, pieces: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(pieces)
    whole = together([decoder(cal).feed(stream)])
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=20)))
    parted = decoder(cal)
    parts = [parted.feed(stream[a:b]) for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    assert together(parts) == whole
    assert len(parted._held) <= LONGEST_LINE
    # Whatever came, two good lines later it reads again.
    assert len(parted.feed(b"\n" + LINE + LINE)) >= 1


def test_an_endless_line_is_one_bad_line_and_held_by_nobody(cal: str) -> None:
    reader = decoder(cal)
    reader.feed(b"\n" + LINE)
    parts = [reader.feed(b"1," * 500) for _ in range(20)]
    parts.append(reader.feed(b"\n" + LINE))
    wrench, rejected, _ = together(parts)
    assert (len(wrench), rejected) == (1, 1)


def test_it_waits_for_a_line_of_the_right_form(cal: str) -> None:
    cell = GaugeLines({"calibration": cal})
    link = Scripted([], [b"0,0\r\n1.0,0,", b"0,0,0,-2.0\r\n"])
    cell.start(link)
    cell.stop(link)
    link.close()


@pytest.mark.parametrize(
    ("heard", "said"), [([], "no lines come"), ([b"GSV-3 1.0\r\n" * 200], "the device says b'GSV-3 1.0")]
)
def test_another_device_or_none_is_said(cal: str, heard: list[bytes | None], said: str) -> None:
    with pytest.raises(DriverError, match=said):
        GaugeLines({"calibration": cal}).start(Scripted([], heard))


def test_settings_that_cannot_be_used(cal: str, tmp_path: Path) -> None:
    with pytest.raises(DriverError, match="lacks calibration"):
        GaugeLines({})
    with pytest.raises(DriverError, match="cannot be read"):
        GaugeLines({"calibration": str(tmp_path / "none.cal")})
    with pytest.raises(DriverError, match="gauge 1 is number 2 of 6"):
        GaugeLines({"calibration": cal, "first_gauge": 2})
    with pytest.raises(DriverError, match="limit_V is -1"):
        GaugeLines({"calibration": cal, "limit_V": -1})
    unranged = str(write_cal(tmp_path / "delta.cal", numbers("delta_FT8506")))
    with pytest.raises(DriverError, match=r"no range of the gauges.*limit_V"):
        GaugeLines({"calibration": unranged})
    assert GaugeLines({"calibration": unranged, "limit_V": 10.0}).rate_hz is None
