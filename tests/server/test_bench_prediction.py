"""Predictions for a bench: those of the model that `compare` uses, with a band that only mistakes leave."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.bench.forces import Likens
from daq.sessions import read_session
from daq.sessions.models import LoadCase
from daq.sessions.protocols import Protocol
from fingermodel.fingers.files import read_finger
from fingermodel.rig import simulate_session
from server.application.bench_prediction import predictor
from tests.daq.bench_plays import PROTOCOL, setup


def test_predictions_are_those_of_the_rig_that_embodies_the_model(tmp_path: Path) -> None:
    finger = read_finger("an1979_middle")
    _, truth = simulate_session(finger, Protocol.model_validate(PROTOCOL), tmp_path)
    predict = predictor(setup())
    cases = {c.id: c for c in read_session(tmp_path).cases}
    told = {name: predict(case) for name, case in cases.items()}
    for name, answer in told.items():
        assert answer is not None
        assert np.abs(answer[0] - truth[name][:3]).max() < 1e-6
        # Another finger stays in the band; a tare taken under the load, or half a large weight, does not.
        assert (np.abs(0.15 * truth[name][:3]) < answer[1]).all()
        assert (np.abs(2.0 * truth[name][:3]) > answer[1]).any()
    bone = told["c004"]
    assert bone is not None
    assert (np.abs(0.5 * truth["c004"][:3]) > bone[1]).any()
    again = cases["c001"].model_copy(update={"id": "c001r1", "repeat_of": "c001", "setting": 2})
    assert predict(again) is not None
    assert predict(LoadCase.model_validate(cases["c001"].model_dump() | {"masses_g": {"LU": 20}})) is None


def test_a_force_of_another_case_is_told_by_a_question_without_a_number(tmp_path: Path) -> None:
    _, truth = simulate_session(read_finger("an1979_middle"), Protocol.model_validate(PROTOCOL), tmp_path)
    predict = predictor(setup())
    assert isinstance(predict, Likens)
    cases = {c.id: c for c in read_session(tmp_path).cases}
    told = 0
    for name, case in cases.items():
        own = truth[name][:3]
        # A specimen is not the model: by a tenth it is never taken for another case.
        assert predict.like(case, 1.1 * own) == ""
        for other, entry in cases.items():
            alike = (entry.posture, entry.location) == (case.posture, case.location)
            far = np.linalg.norm(truth[other][:3] - own) > 0.6 * (0.4 * np.linalg.norm(own) + 0.3)
            if alike and far and entry.masses_g != case.masses_g:
                said = predict.like(case, truth[other][:3])
                told += 1
                assert said.startswith("reads ")
                assert said.endswith("?")
                assert (
                    any(f"{tendon} {grams:g} g" in said for tendon, grams in entry.masses_g.items()) or "hardly" in said
                )
    assert told
    heavy = max(cases.values(), key=lambda c: float(np.linalg.norm(truth[c.id][:3])))
    assert "does the weight hang" in predict.like(heavy, np.zeros(3))
