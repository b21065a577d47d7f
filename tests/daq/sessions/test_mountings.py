"""Which mounting of the cell a known weight was hung on."""

from __future__ import annotations

from typing import Any

import pytest

from daq.sessions import parse_session
from daq.sessions.mountings import mounting_of
from tests.daq.benches import averaged, recorded

MOVED: dict[str, Any] = {"t_s": 37.5, "kind": "move_cell"}


def found(when: str, begin_s: float, *events: dict[str, Any], averages: bool = False, mount: str = "tip") -> int:
    """Mounting of a weight at a time; loads at 24 s and 56 s are read in mountings 1 and 2 of the tip."""
    data = averaged() | {"readings": "readings.csv"} if averages else recorded(4)
    data["cases"] = data["cases"][-2:]
    for k, case in enumerate(data["cases"]):
        case |= {"location": "tip", "mounting": 1 + k}
        if not averages:
            case |= {"unloaded_s": [18 + 32 * k, 19 + 32 * k], "loaded_s": [23 + 32 * k, 25 + 32 * k]}
    windows = {"unloaded_s": [begin_s, begin_s + 0.5], "loaded_s": [begin_s + 1.0, begin_s + 2.0]}
    data["checks"] = [{"when": when, "mount": mount, "mass_g": 200, "direction": "-y", **windows}]
    data["events"] = list(events)
    session, faults = parse_session(data, None)
    assert session is not None, faults
    return mounting_of(session.checks[0], session)


@pytest.mark.parametrize(
    ("begin_s", "events", "mounting"),
    [
        (2.0, [], 1),
        (30.0, [], 1),
        (45.0, [], 2),
        (60.0, [], 2),
        # After the cell was moved and before the next load it hangs on the new mounting, however soon.
        (38.0, [MOVED], 2),
        (35.0, [MOVED], 1),
        (38.0, [MOVED | {"value": {"location": "tip", "mounting": 2}}], 2),
        # That the cell came to the bone is no other mounting at the tip.
        (30.0, [MOVED | {"t_s": 28.0, "value": {"location": "bone", "mounting": 0}}], 1),
        # Before all loads, and after all of them.
        (2.0, [MOVED | {"t_s": 10.0}], 0),
        (62.0, [MOVED | {"t_s": 60.0}], 3),
    ],
)
def test_a_known_weight_hangs_on_the_mounting_of_its_time(
    begin_s: float, events: list[dict[str, Any]], mounting: int
) -> None:
    # What is said of the whole session does not count where the time is known.
    assert found("before", begin_s, *events) == found("after", begin_s, *events) == mounting


@pytest.mark.parametrize(("when", "mounting"), [("before", 1), ("during", 1), ("after", 2)])
def test_averaged_forces_have_no_time(when: str, mounting: int) -> None:
    assert found(when, 0.0, averages=True) == mounting


def test_where_no_load_was_read_the_cell_was_not_moved() -> None:
    assert found("after", 60.0, mount="bone") == 0
