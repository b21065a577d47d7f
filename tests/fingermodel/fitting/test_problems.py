"""What a refit may do with its parameters."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.fitting.problems import map_problem
from fingermodel.session import Session


@pytest.mark.parametrize("session", ["DEV-02", "synek2019_H01", "synek2019_B01"])
def test_no_tendon_point_passes_the_segments_other_one(session: str) -> None:
    bench = Session.open(session, catalogue=False)
    problem = map_problem(bench.model, bench.observations)
    topology, centres = bench.model.finger.topology, np.asarray(bench.model.values.centre)
    joints = [j.name for j in topology.joints]
    index = bench.model.parameters.index
    for segment in topology.segments:
        proximal, distal = (
            np.array([index[f"point.{segment.name}.{end}.{axis}"] for axis in "xyz"]) for end in ("proximal", "distal")
        )
        centre = centres[joints.index(segment.joint)]
        start = problem.start[distal] - (problem.start[proximal] - centre)
        along = int(np.argmax(np.abs(start)))
        # As near to each other as the bounds allow, they still lie the same way round.
        nearest = (
            problem.lower[distal[along]] - problem.upper[proximal[along]]
            if start[along] > 0.0
            else problem.upper[distal[along]] - problem.lower[proximal[along]]
        )
        assert (nearest + centre[along]) * np.sign(start[along]) > 0.0, segment.name
        assert (problem.lower <= problem.start).all()
        assert (problem.start <= problem.upper).all()
