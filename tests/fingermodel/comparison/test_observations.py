"""A measured session as the model sees it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.signals.corrections import measure
from fingermodel.session import Session
from tests.daq.benches import WRENCH, bench, record, recorded, window

ZERO = np.zeros(6)


@pytest.mark.parametrize(("moved", "mountings"), [(False, [1, 1, 1, 1]), (True, [1, 2, 1, 2])])
def test_a_known_weight_belongs_to_the_mounting_that_it_hung_on(
    moved: bool, mountings: list[int], tmp_path: Path
) -> None:
    data = recorded(2)
    for k, case in enumerate(data["cases"]):
        case |= {"role": "identification", "mounting": 1 + moved * k}
    weight = {"mount": "tip", "mass_g": 200, "direction": "-y"}
    data["cases"][1] |= {"unloaded_s": window(4), "loaded_s": window(5)}
    data["checks"] = [
        {"when": "before", **weight, "unloaded_s": window(2), "loaded_s": window(3)},
        {"when": "after", **weight, "unloaded_s": window(6), "loaded_s": window(7)},
    ]
    known = np.array([0.0, -1.962, 0.0, 0.0, 0.0, 0.0])
    levels = [ZERO, ZERO + WRENCH, ZERO, known, ZERO, ZERO + WRENCH, ZERO, known]
    data["events"] = [{"t_s": window(4)[0] - 0.6, "kind": "move_cell"}] if moved else []
    observations = Session.of(measure(bench(tmp_path / "s", data, record(levels))), catalogue=False).observations
    layout = observations.layout
    assert layout.mountings == tuple(("tip", k) for k in dict.fromkeys(mountings))
    assert [layout.mountings[k][1] for k in np.asarray(observations.inputs.mounting)] == mountings
