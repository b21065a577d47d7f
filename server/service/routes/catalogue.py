"""Catalogue of the service: effects and protocols, and users' own effects."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from pydantic import Field

from daq.sessions.protocols import plan, protocol_names, read_protocol
from server.service.answers import JsonAnswer
from server.service.schemas.common import Answered, Form, Plain, Shown, documented
from server.service.services import of
from server.service.web.examples import EXAMPLES
from server.service.web.problems import not_found
from server.service.web.strict_requests import ReadingRoute

router = APIRouter(route_class=ReadingRoute, tags=["catalogue"])

Name = Annotated[str, Path(max_length=100)]


class EffectParameter(Shown):
    """A parameter of an effect."""

    name: str = Field(description="`effect.place`.", examples=["worn_pulley.FDP"])
    unit: str
    null: float = Field(description="At which the effect changes nothing [unit].")
    range: list[float] | None = Field(description="Plausible values [unit].")
    prior_sd: float | None = Field(description="Standard deviation of its prior [unit]; null where it has none.")
    one_sided: bool


class EffectShown(Shown):
    """A physical effect that a model may lack."""

    name: str
    stage: str = Field(description="tension, geometry, sharing, torque or reading.")
    title: str
    formula: str
    tell: str = Field(description="What gives it away in the data.")
    source: str
    own: bool = Field(description="Whether a user gave it.")
    candidates: list[str]
    parameters: list[EffectParameter]


class EffectRead(EffectShown, Answered):
    """One effect."""


class EffectList(Answered):
    """The catalogue, then users' own effects."""

    effects: list[EffectShown]


class NewEffect(Form):
    """An effect of one's own: a whole fingertwin-effect/1, or a bare formula with one coefficient k."""

    formula: Annotated[str | None, Field(max_length=2000, examples=["torque[PIP] += k * t_EDC * sin(q_PIP)"])] = None
    document: Annotated[
        Plain | None,
        Field(
            description="Name, title, formulas, parameters with units and ranges.",
            examples=[EXAMPLES["NewEffect"]["document"]],
        ),
    ] = None

    def given(self) -> dict[str, Any]:
        """Return the document, or the formula alone."""
        return self.document if self.document is not None else {"formula": self.formula}


class Named(Shown):
    """A protocol."""

    name: str


class ProtocolRead(Named, Answered):
    """A protocol with its load cases in order."""

    document: Plain = Field(description="protocol/1.")
    cases: list[Plain] = Field(description="Load cases, repeats at the end.")


class ProtocolList(Answered):
    """Bench protocols that come with the software."""

    protocols: list[Named]


@router.get("/effects", responses=documented(EffectList))
def effects(request: Request) -> JsonAnswer:
    """List the effects: formula, parameters, units, ranges, source."""
    return JsonAnswer({"schema": "fingertwin/effects/1", "effects": of(request).effects.shown()})


@router.get("/effects/{name}", responses=documented(EffectRead))
def effect(name: Name, request: Request) -> JsonAnswer:
    """Return one effect."""
    return _one_effect(of(request).effects.one(name))


@router.post("/effects", status_code=201, responses=documented(EffectRead, status=201) | {200: {"model": EffectRead}})
def add_effect(body: NewEffect, request: Request) -> JsonAnswer:
    """Keep an effect of one's own: a formula on a whitelist, which is parsed and never run as code."""
    shown, new = of(request).effects.add(body.given())
    return _one_effect(shown, 201 if new else 200)


@router.post("/effects/check", responses=documented(EffectRead))
def check_effect(body: NewEffect, request: Request) -> JsonAnswer:
    """Say what an effect of one's own would be, without keeping it."""
    return _one_effect(of(request).effects.check(body.given()))


@router.get("/protocols", responses=documented(ProtocolList))
def protocols() -> JsonAnswer:
    """List the bench protocols."""
    rows = []
    for name in protocol_names():
        protocol = read_protocol(name)
        planned, seconds = plan(protocol)
        rows.append({"name": name, "title": protocol.title, "cases": len(planned), "seconds": seconds})
    return JsonAnswer({"schema": "fingertwin/protocols/1", "protocols": rows})


@router.get("/protocols/{name}", responses=documented(ProtocolRead))
def protocol(name: Name) -> JsonAnswer:
    """Return a bench protocol with its load cases in order."""
    if name not in protocol_names():
        raise not_found("protocol", name, "/api/v1/protocols")
    found = read_protocol(name)
    cases = [asdict(c) for c in plan(found)[0]]
    head = {"schema": "fingertwin/protocol/1", "name": name}
    return JsonAnswer(head | {"document": found.model_dump(mode="json"), "cases": cases})


def _one_effect(shown: dict[str, Any], status: int = 200) -> JsonAnswer:
    return JsonAnswer({"schema": "fingertwin/effect/1"} | shown, status)
