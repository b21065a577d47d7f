"""Where a model fails: cells agree with the comparison of the same fit, and bent errors of the rig are told."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.comparison.comparison import compare
from fingermodel.diagnosis.answer.where import where
from fingermodel.session import Session
from tests.stated import stated_problem


def test_a_cell_is_the_root_mean_square_of_what_its_cases_have() -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    table, plane = bench.model.parameters, bench.model.finger.judged_in
    theta = bench.theta.copy()
    at = table.index["cell_gain.Fx"]
    theta[at] = 5.0 * table.sd[at] + table.initial[at]
    found = where(stated_problem(bench.model, bench.observations, plane, ()), theta)
    cases = [c for c in compare(bench.model, bench.observations, theta).cases if c.role == "identification"]
    assert sum(cell["cases"] for cell in found["cells"]) == len(cases)
    for cell in found["cells"]:
        key = (cell["muscles"], cell["posture"], cell["location"])
        z = [c.z_in(plane) for c in cases if (c.muscles, c.posture, c.location) == key]
        assert cell["z_rms"] == pytest.approx(np.sqrt(np.mean(np.square(np.array(z, dtype=float)))))
    (bent,) = found["bent"]
    assert (bent["name"], bent["widths"]) == ("cell_gain.Fx", pytest.approx(5.0))
    assert "known weight" in bent["remedy"]
