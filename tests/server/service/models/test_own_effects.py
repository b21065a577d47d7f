"""Effects of users at the service: kept or refused, and never in the way of the others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import insert

from fingermodel.effects.user import effect_document
from server.application.additions import formula_of
from server.service.storage.database import now_utc
from server.service.storage.schema import own_effects
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/effects"
FORMULA = "torque[PIP] += k * t_EDC * sin(q_PIP)"


@pytest.fixture
def service(tmp_path: Path) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path)
    yield out
    out.close()


def names(service: ServiceReceiver) -> list[str]:
    listed = service.client().get(AT)
    assert listed.status_code == 200, listed.text
    return [e["name"] for e in listed.json()["effects"] if e["own"]]


def test_nothing_is_kept_of_an_effect_that_is_refused(service: ServiceReceiver) -> None:
    for formula in ("torque[PIP] += k * t_XXX", "torque[IP] += k * t_FPL", "tension[FPL] *= 1 - k"):
        refused = service.client().post(AT, json={"formula": formula})
        assert refused.status_code == 422
        assert "which this finger does not have" in refused.json()["detail"]
        assert names(service) == []


def test_an_effect_that_an_earlier_version_kept_does_not_hide_the_others(service: ServiceReceiver) -> None:
    kept = service.client().post(AT, json={"formula": FORMULA}).json()["name"]
    document = effect_document(formula_of("torque[PIP] += k * t_XXX"))
    with service.parts.database.writing() as connection:
        row = {"name": document["name"], "created_utc": now_utc(), "document": document}
        connection.execute(insert(own_effects).values(row))
    assert names(service) == [kept]


def test_several_formulas_may_be_tried_at_one_place(service: ServiceReceiver) -> None:
    formulas = (FORMULA, "torque[PIP] += k * t_FDP", "torque[PIP] *= 1 - k")
    made = [service.client().post(AT, json={"formula": f}) for f in formulas]
    assert [m.status_code for m in made] == [201, 201, 201]
    checked = [service.client().post(f"{AT}/check", json={"formula": f}).json()["name"] for f in formulas]
    assert [m.json()["name"] for m in made] == checked
    assert sorted(names(service)) == sorted(checked)
    assert service.client().post(AT, json={"formula": FORMULA}).status_code == 200
