"""Figures of the finger and of effects over REST: weights, forces, and what an effect changes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fingermodel import comparing
from fingermodel.comparison.comparison import compare
from fingermodel.session import Session
from tests.server.service.figures_asked import shown, traces
from tests.server.service.recorded import holding
from tests.server.service.running import ServiceReceiver

RECORDED = "DEV-01"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    yield from holding(tmp_path_factory.mktemp("service"), RECORDED)


def test_the_finger_holds_the_weights_and_forces_of_its_case(service: ServiceReceiver) -> None:
    bench = Session.open(RECORDED, catalogue=False)
    for found in (c for c in comparing.compare(bench).cases if c.id in ("c001", "c030", "c090")):
        body = shown(service, "/finger", session=RECORDED, case=found.id)
        weights = {t["meta"]["tendon"]: t["meta"]["mass_g"] for t in traces(body, "weight")}
        assert weights == {m: g for m, g in found.masses_g.items() if g}
        place = body["figure"]["layout"]["meta"]
        # In a report nothing breaks its lines: each has room beside the other, at 6.1 px a letter.
        title, room = body["figure"]["layout"]["title"], body["figure"]["layout"]["width"] - 36
        assert max(6.1 * len(line) for line in title["subtitle"]["text"].split("<br>")) <= room
        rotation = np.array(place[found.location]["rotation"])
        for kind, force in (("measured", found.measured_N), ("predicted", found.predicted_N)):
            (arrow,) = traces(body, kind)
            assert arrow["meta"]["force_N"] == pytest.approx((rotation @ force)[:2])
            assert [arrow["x"][0], arrow["y"][0]] == pytest.approx(place[found.location]["origin_mm"])
            size = float(np.hypot(*(rotation @ force)[:2]))
            (head,) = traces(body, f"{kind}_head")
            reach = np.hypot(head["x"][0] - arrow["x"][0], head["y"][0] - arrow["y"][0])
            assert reach == pytest.approx(size * place["mm_per_N"])


def test_the_finger_alone_has_neither_weights_nor_forces(service: ServiceReceiver) -> None:
    body = shown(service, "/finger", session=RECORDED, posture="hook")
    assert [traces(body, k) for k in ("weight", "measured", "predicted")] == [[], [], []]
    assert "MCP 0°, PIP 65°, DIP 50°" in body["text"]
    assert body["figure"]["layout"]["meta"]["mm_per_N"] > 0.0


@pytest.mark.parametrize("effect", ["worn_pulley.FDP", "worn_pulley", "tip_location"])
def test_an_effect_is_drawn_as_the_difference_that_it_makes(service: ServiceReceiver, effect: str) -> None:
    body = shown(service, f"/effect/{effect}", session=RECORDED)
    bench = Session.open(RECORDED)
    theta = bench.theta.copy()
    for setting in body["parameters"]:
        parameter = bench.model.parameters.parameters[bench.model.parameters.index[setting["name"]]]
        assert parameter.plausible is not None
        assert setting["value"] == parameter.plausible[1]
        theta[bench.model.parameters.index[setting["name"]]] = setting["value"]
    before = {c.id: c for c in compare(bench.model, bench.observations, bench.theta).cases}
    after = {c.id: c for c in compare(bench.model, bench.observations, theta).cases}
    bars, circles = traces(body, "change"), traces(body, "missing")
    assert len(bars) == len(circles) == 3
    for axis, (bar, circle) in enumerate(zip(bars, circles, strict=True)):
        cases = bar["meta"]["cases"]
        assert sorted(cases) == sorted(before)
        change = [after[c].predicted_N[axis] - before[c].predicted_N[axis] for c in cases]
        assert bar["y"] == pytest.approx(change, abs=1e-9)
        assert circle["y"] == pytest.approx([before[c].measured_N[axis] - before[c].predicted_N[axis] for c in cases])
    if effect == "worn_pulley.FDP":
        moved = {c for bar in bars for c, y in zip(bar["meta"]["cases"], bar["y"], strict=True) if abs(y) > 1e-9}
        assert moved == {c for c, found in before.items() if found.masses_g.get("FDP")}


def test_a_users_own_effect_is_drawn_too(service: ServiceReceiver) -> None:
    formula = "torque[PIP] += k * t_EDC * sin(q_PIP)"
    own = service.client().post("/api/v1/effects", json={"formula": formula}).raise_for_status().json()["name"]
    body = shown(service, f"/effect/{own}", session=RECORDED)
    bars = traces(body, "change")
    loaded = {
        c.id
        for c in comparing.compare(Session.open(RECORDED, catalogue=False)).cases
        if c.masses_g.get("EDC") and c.location == "tip"
    }
    moved = {c for bar in bars for c, y in zip(bar["meta"]["cases"], bar["y"], strict=True) if abs(y) > 1e-9}
    assert loaded
    assert loaded <= moved
