"""A scaled finger's document: what was not measured is assumed, and its own lengths change nothing."""

from __future__ import annotations

import pytest

from fingermodel.fingers.files import read_finger
from fingermodel.studies.scaling import scale_finger, scaled_document

HUMAN = "synek2019_initial"


def test_a_bone_that_was_not_measured_takes_the_mean_factor_and_is_assumed() -> None:
    done = scale_finger(HUMAN, {"PP": 47.0237 * 1.1, "MP": 28.8286 * 1.21}, {}, {}, "x")
    factor = {b.bone: b.factor for b in done.bones}
    assert factor["DP"] == pytest.approx((1.1 * 1.21) ** 0.5, rel=1e-4)
    document = scaled_document(done)
    certainty = {f"{s['joint']}.{s['slip']}": s["certainty"] for s in document["segments"]}
    assert (certainty["DIP.FDP"], certainty["PIP.FDP"]) == ("assumed", "low")
    assert document["load_point"]["certainty"] == "assumed"


def test_its_own_lengths_leave_every_number_and_source_as_it_was() -> None:
    from fingermodel.scaling import phalanx_lengths

    base = read_finger(HUMAN)
    document = scaled_document(scale_finger(HUMAN, phalanx_lengths(base), {}, {}, "same"))
    assert document["segments"] == base.document["segments"]
    assert document["load_point"] == base.document["load_point"]
