"""Headers of other languages and orders: the right channel by its unit or its word, or one line of refusal."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from daq.errors import ReadingsError
from daq.lab.files import AXES, Increment, Taken
from daq.lab.opened import open_channels
from daq.lab.proposals import propose_mapping

# Words for force and torque that no list of the product has, so that only letters, units and order tell.
FORCE, TORQUE = "Indar", "Momentu"
NAMES = [f"{word} {x}" for word in (FORCE, TORQUE) for x in "XYZ"]


def table(path: Path, labels: list[str], separator: str = ";", rows: int = 6, head: tuple[str, ...] = ()) -> Path:
    """Columns of which each number is its column's place, time first; labels without a time's."""
    lines = [separator.join(str(k if k else 0.01 * i) for k in range(len(labels))) for i in range(rows)]
    path.write_text("\n".join([separator.join(labels), *head, *lines]) + "\n", "utf-8")
    return path


def places(path: Path, rate_hz: float | None = None) -> list[str]:
    channels = propose_mapping(path, rate_hz=rate_hz).channels
    return [channels[axis].channel for axis in AXES]


@pytest.mark.parametrize("order", list(itertools.permutations(range(6)))[::37])
def test_six_letters_with_units_are_told_apart_in_any_order(order: tuple[int, ...], tmp_path: Path) -> None:
    labels = [f"{NAMES[k]} ({'lbf' if k < 3 else 'in-lb'})" for k in order]
    found = places(table(tmp_path / "r.csv", ["Denbora (s)", *labels]))
    assert [name.split(" (")[0] for name in found] == NAMES


def test_words_of_which_one_is_known_are_told_apart(tmp_path: Path) -> None:
    names = [f"{word} {x}" for word in ("Moment", FORCE) for x in "XYZ"]
    assert places(table(tmp_path / "r.csv", ["t (s)", *names])) == names[3:] + names[:3]


@pytest.mark.parametrize(
    "names",
    [
        [f"{a} {x}" for a, x in zip([FORCE, TORQUE] * 3, "XYXZYZ", strict=True)][:6],
        [f"kanal {x}" for x in "XXYYZZ"],
        [f"{NAMES[k]} ({'Nmm' if k != 4 else 'N'})" for k in range(6)],
    ],
    ids=["words that do not pair", "one word, letters in pairs", "units that do not fit"],
)
def test_names_that_tell_another_order_are_not_taken_by_their_place(names: list[str], tmp_path: Path) -> None:
    with pytest.raises(ReadingsError, match="do not tell which is which"):
        propose_mapping(table(tmp_path / "r.csv", ["t (s)", *names]))


def test_a_unit_of_torque_is_never_proposed_for_a_force(tmp_path: Path) -> None:
    names = [f"kanal{k} ({unit})" for k, unit in enumerate(["Nmm", "N", "N", "N", "Nmm", "Nmm"])]
    with pytest.raises(ReadingsError, match="do not tell which is which"):
        propose_mapping(table(tmp_path / "r.csv", ["t (s)", *names]))


def test_a_column_whose_unit_is_one_of_time_is_the_time(tmp_path: Path) -> None:
    labels = ["Zenbakia", "Denbora (ms)", *(f"{a} ({'N' if a[0] == 'F' else 'Nmm'})" for a in AXES)]
    found = propose_mapping(table(tmp_path / "r.csv", labels))
    assert found.time == Taken(channel="Denbora (ms)", unit="ms")
    assert any("Denbora (ms)" in doubt for doubt in found.doubts)


def test_a_numbered_column_is_no_time_where_the_rate_is_stated(tmp_path: Path) -> None:
    path = table(tmp_path / "r.csv", ["Zenbakia", *AXES])
    assert propose_mapping(path, rate_hz=50.0).time == Increment(increment_s=0.02)


def test_a_letter_in_brackets_is_no_unit(tmp_path: Path) -> None:
    found = propose_mapping(table(tmp_path / "r.csv", ["t (s)", *(f"{k} ({x})" for k in "FM" for x in "xyz")]))
    assert [taken.unit for taken in found.channels.values()] == [None] * 6


def test_quoted_names_between_spaces_are_read(tmp_path: Path) -> None:
    """As write.table of R writes them, without names of rows."""
    labels = ['"t (s)"', *(f'"{a[0]}{a[1]} ({"N" if a[0] == "F" else "N mm"})"' for a in AXES)]
    source = open_channels(table(tmp_path / "r.txt", labels, "  "))
    assert [c.name for c in source.channels] == [label.strip('"') for label in labels]
    (block,) = source.blocks([c.name for c in source.channels])
    np.testing.assert_array_equal(block[2], [0.02, 1, 2, 3, 4, 5, 6])


def test_a_row_of_units_with_a_word_too_few_is_not_heeded(tmp_path: Path) -> None:
    """Between spaces nothing tells which column has none."""
    source = open_channels(table(tmp_path / "r.txt", ["n", "t", *AXES], " ", head=("s N N N Nmm Nmm Nmm",)))
    assert [c.unit for c in source.channels] == [""] * 8
    assert "its row of units has 7 words for 8 columns and is not heeded" in source.notes


def test_numbers_that_are_none_are_no_units_of_the_row_below(tmp_path: Path) -> None:
    path = table(tmp_path / "r.csv", ["t (s)", *AXES])
    path.write_text(path.read_text("utf-8").replace(";5;", ";nan;"), "utf-8")
    source = open_channels(path)
    assert [c.unit for c in source.channels] == [""] * 7
    with pytest.raises(ReadingsError, match="line 2: Ty is 'nan'; expected a finite number"):
        list(source.blocks(["Ty"]))
