"""What the service keeps: sessions, load cases, edits, effects; and how it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fingertwin.client.exchange import Body, reading
from fingertwin.client.summaries import Floats, made, names, vector_or_none


@dataclass(frozen=True, eq=False)
class SessionInfo:
    """A session as it stands.

    Attributes:
        id: of the session.
        version: raised by every change.
        source: `document`, `bench`, or `none` where nothing is known yet.
        closed: whether predictions of validation cases may be seen.
        specimen, finger, protocol: as its document names them.
        cases: how many are in each state.
        streams: each with `next_seq`, the number of readings that are stored.
        problem: why the session cannot be used, where it cannot.
        body: the whole answer.
    """

    id: str
    version: int
    source: str
    closed: bool
    specimen: str | None
    finger: str | None
    protocol: str | None
    cases: Mapping[str, int]
    streams: tuple[Body, ...]
    problem: str | None
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> SessionInfo:
        """Of the service's answer."""
        with reading("a session"):
            return made(cls, body, streams=tuple(body["streams"]), body=body)


@dataclass(frozen=True, eq=False)
class LoadCase:
    """A load case of a session, and how far it is.

    Attributes:
        id, role, posture, location, masses_g: as the session's document has them.
        state: measured, waiting, failed or excluded.
        why: in words, where it is not measured.
        windows: unloaded_s, loaded_s, unloaded_after_s: [start, end] in s.
        measured_N, measured_sd_N: (3,) force on the cell, mount axes, tare removed; None where it has none yet.
        predicted_N, residual_N: (3,) by the session's own model; None where they may not be seen.
        z: Mahalanobis norm of the residual.
        blinded: whether its prediction is hidden until the bench closes the session.
        body: the whole answer.
    """

    id: str
    role: str | None
    posture: str | None
    location: str | None
    masses_g: Mapping[str, float] | None
    state: str
    why: str
    windows: Mapping[str, list[float]]
    measured_N: Floats | None
    measured_sd_N: Floats | None
    predicted_N: Floats | None
    residual_N: Floats | None
    z: float | None
    blinded: bool
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> LoadCase:
        """Of the service's answer."""
        with reading("a load case"):
            forces = ("measured_N", "measured_sd_N", "predicted_N", "residual_N")
            return made(cls, body, **{key: vector_or_none(body[key]) for key in forces}, body=body)


@dataclass(frozen=True, eq=False)
class Edit:
    """A change of a session, which `Session.undo` takes back.

    Attributes:
        number: of the edit.
        kind: case, windows, exclude, include or undo; None where the answer does not say.
        case: the load case after it; None where there is none (any more), or the answer does not say.
        body: the whole answer.
    """

    number: int
    kind: str | None
    case: LoadCase | None
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Edit:
        """Of the service's answer to a change."""
        with reading("an edit"):
            return cls(body["edit"], None, None if body["case"] is None else LoadCase.of(body["case"]), body)

    @classmethod
    def of_list(cls, body: Body) -> Edit:
        """Of a row of the list of edits."""
        with reading("an edit"):
            return cls(body["number"], body["kind"], None, body)


@dataclass(frozen=True, eq=False)
class Effect:
    """A physical effect that a model may lack.

    Attributes:
        name: that `Session.add` takes.
        stage: tension, geometry, sharing, torque or reading.
        title, formula, tell, source: in words: what it is, what it computes, what gives it away, who says so.
        own: whether a user gave it.
        candidates: its variants, which `Session.add` takes too.
        parameters: with name, unit, null, range and prior_sd.
        body: the whole answer.
    """

    name: str
    stage: str
    title: str
    formula: str
    tell: str
    source: str
    own: bool
    candidates: tuple[str, ...]
    parameters: tuple[Body, ...] = field(repr=False)
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Effect:
        """Of the service's answer."""
        with reading("an effect"):
            parameters = tuple(body["parameters"])
            return made(cls, body, candidates=names(body["candidates"]), parameters=parameters, body=body)


@dataclass(frozen=True, eq=False)
class Friction:
    """The friction factor by force balance (Synek et al. 2019, Eq 1).

    Attributes:
        factor: c, pooled over the cases.
        sem: its standard uncertainty; None for one case.
        interval: (low, high), 95 %.
        cases: each with session, posture, masses_g, factor and factor_sd.
        notes: what limits the numbers.
        body: the whole answer, as `fingertwin friction --json` gives it.
    """

    factor: float
    sem: float | None
    interval: tuple[float | None, float | None]
    cases: tuple[Body, ...] = field(repr=False)
    notes: tuple[str, ...]
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Friction:
        """Of the service's answer."""
        with reading("friction"):
            pooled = body["pooled"]
            interval = (pooled["low"], pooled["high"])
            return cls(pooled["factor"], pooled["sem"], interval, tuple(body["cases"]), names(body["notes"]), body)


@dataclass(frozen=True, eq=False)
class Health:
    """How the service is.

    Attributes:
        status: ok or degraded.
        ready: whether its models are warm.
        version: of fingertwin there.
        problems: what is wrong, in words.
        database, workers: how they are.
        body: the whole answer.
    """

    status: str
    ready: bool
    version: str
    problems: tuple[str, ...]
    database: Mapping[str, Any]
    workers: Mapping[str, Any]
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Health:
        """Of the service's answer."""
        with reading("health"):
            return made(cls, body, problems=names(body["problems"]), body=body)
