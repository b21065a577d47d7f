"""What no list foresees: an effect in one posture alone, a tendon whose arm is not that of the finger's file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.recovery.diagnosed import diagnosed
from tests.simulator import CATALOGUE, draw_session
from tests.simulator.finger import Floats
from tests.simulator.rig import Acting, acting
from tests.simulator.situation import Effect, Situation


@pytest.mark.full
def test_an_effect_in_one_posture_alone_is_told_there_and_gets_no_other_name(tmp_path: Path) -> None:
    """Joint friction where the clamp was too tight. Two other effects, far off, would explain as much."""
    effect, posture = CATALOGUE["joint_friction"], "major_flexion"
    rubs = acting(effect, np.array([0.2, 0.2, 0.2]), 71)

    def rub(s: Situation, size: Floats, shape: Floats) -> None:
        if s.case.posture == posture:
            effect.act(s, size, shape)

    draw_session(tmp_path, 71, nuisance_scale=1.0, unforeseen=[replace(rubs, effect=replace(effect, act=rub))])
    found = diagnosed(tmp_path)
    assert (found["verdict"], found["effects"], found["session_faults"]) == ("none_of_catalogue", [], [])
    assert found["beyond"]["of_one_alone"][posture] > 0.9


def test_a_tendon_whose_arm_is_another_than_the_fingers_is_named_and_not_passed_over(tmp_path: Path) -> None:
    """Of a slip that was cut: no small error of a specimen, though every reading is explained by it."""

    def cut(s: Situation, size: Floats, shape: Floats) -> None:
        s.tension = np.where(s.finger.of("FDS", joint="PIP"), size[0] * s.tension, s.tension)

    sharing = Effect("cut_slip", "sharing", "1", 0.0, 1.0, ("",), cut)
    draw_session(tmp_path, 72, nuisance_scale=1.0, unforeseen=[Acting(sharing, np.array([0.6]), np.zeros(8))])
    found = diagnosed(tmp_path)
    assert (found["verdict"], found["effects"]) == ("undecided", [])
    assert any("FDS at the PIP (a moment arm of " in reason for reason in found["reasons"])
