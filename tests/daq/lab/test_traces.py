"""What is drawn of a recording: each peak, of any length, without holding it."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from daq.lab.channels import Channel, Floats, LabChannels
from daq.lab.envelope import STRETCHES, Envelope
from daq.lab.opened import open_channels
from daq.lab.traces import read_traces
from tests.daq.lab_files import VOLT_ROWS, VOLTAGES, lvm

PEAKS = {17: 9.0, 44_321: -7.0, 99_999: 8.0}


@pytest.mark.parametrize("size", [1, 777, 16_384, 100_000])
def test_a_drawn_line_keeps_its_peaks(size: int) -> None:
    count = 100_000 if size > 1 else 45_000
    values = np.random.default_rng(1).normal(0.0, 1.0, (count, 2))
    for row, peak in PEAKS.items():
        if row < count:
            values[row, 1] = peak
    envelope = Envelope(2)
    for first in range(0, count, size):
        envelope.add(np.arange(first, min(first + size, count)) / 8.0, values[first : first + size])
    assert envelope.readings == count
    np.testing.assert_array_equal([envelope.lows, envelope.highs], [values.min(axis=0), values.max(axis=0)])
    for channel, (t, drawn) in enumerate(envelope.lines()):
        assert STRETCHES <= len(t) <= 2 * STRETCHES + 2
        assert (np.diff(t) > 0.0).all()
        np.testing.assert_array_equal(drawn, values[(8.0 * t).astype(int), channel])
        # Of any few thousandths of the recording, the least and the greatest are there.
        for piece in np.array_split(np.arange(count), 200):
            own = drawn[(t >= piece[0] / 8.0) & (t <= piece[-1] / 8.0)]
            inner = values[piece[len(piece) // 4] : piece[-len(piece) // 4], channel]
            assert own.min() <= inner.min()
            assert own.max() >= inner.max()


def test_a_short_line_is_drawn_whole() -> None:
    envelope = Envelope(1)
    values = np.random.default_rng(2).normal(size=(2000, 1))
    envelope.add(np.arange(2000.0), values)
    ((t, drawn),) = envelope.lines()
    np.testing.assert_array_equal(t, np.arange(2000.0))
    np.testing.assert_array_equal(drawn, values[:, 0])


class Long(LabChannels):
    """Two hours at 500 Hz, made as they are asked for; in steps of 20 s."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels = tuple(Channel(name, "N", increment_s=0.002) for name in ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        rng = np.random.default_rng(3)
        for first in range(0, 3_600_000, 10_000):
            level = np.where((np.arange(first, first + 10_000) // 10_000) % 2, 2.0, 0.0)[:, None]
            yield level + rng.normal(0.0, 0.02, (10_000, len(names)))


def test_a_long_recording_is_never_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.lab.traces.open_channels", Long)
    tracemalloc.start()
    try:
        traces = read_traces(Path("long.csv"))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert traces.readings == 3_600_000
    assert len(traces.plateaus) == 360
    assert traces.plateaus[-1] == pytest.approx((7180.3, 7199.7), abs=0.2)
    assert most < 60e6  # the readings are 173 MB


def test_means_that_are_too_many_become_means_of_twice_as_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a recording of weeks is not held in tenths of a second."""
    monkeypatch.setattr("daq.lab.traces.open_channels", Long)
    monkeypatch.setattr("daq.lab.levels._MOST_MEANS", 6 * 40_001)
    ends = np.array(read_traces(Path("long.csv")).plateaus)
    assert len(ends) == 360
    np.testing.assert_allclose(ends, 20.0 * np.arange(360)[:, None] + [0.3, 19.7], rtol=0.0, atol=0.45)


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", ","), ("\t", "."), (" ", "."), ("  ", ",")], ids=str
)
def test_plain_text_is_read_to_the_numbers_that_it_has_cell_by_cell(
    separator: str, decimal: str, tmp_path: Path
) -> None:
    """A block of nothing but numbers is read at once; one with a cell in quotation marks cell by cell."""
    cells = ["1.", ".5", "-3e-2", "+4", "7", "0.1000000000000000055", "123456789.123456789", "1E5", "00012", "-0"]
    rows = [[cells[(i + k) % len(cells)].replace(".", decimal) for k in range(3)] for i in range(40)]
    texts = [separator.join(row) for row in rows]
    read = []
    for quoted in (False, True):
        last = separator.join(f'"{cell}"' for cell in rows[-1]) if quoted and separator.strip() else texts[-1]
        blank = "" if quoted else "\n\n"
        file = tmp_path / f"{quoted}.csv"
        end = separator if quoted and not separator.strip() else ""
        file.write_text("\n".join(["a;b;c".replace(";", separator), *texts[:-1], blank + last + end]) + "\n", "utf-8")
        source = open_channels(file)
        assert [c.name for c in source.channels] == ["a", "b", "c"]
        read.append(np.concatenate(list(source.blocks(["c", "a"]))))
    wanted = [[float(row[i].replace(decimal, ".")) for i in (2, 0)] for row in rows]
    np.testing.assert_array_equal(read[0], wanted)
    np.testing.assert_array_equal(read[1], wanted)


@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_channels_of_labview_are_all_drawn(x_columns: str, tmp_path: Path) -> None:
    """Its header states an increment for each channel, and none for the column of time."""
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS, x_columns=x_columns)
    traces = read_traces(path)
    assert traces.names == VOLTAGES
    assert not [note for note in traces.notes if "left out" in note]
