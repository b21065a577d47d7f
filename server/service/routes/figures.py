"""Figures as Plotly JSON: comparisons, diagnoses, the fall of the error, the finger at the bench, effects."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Hashable
from contextlib import suppress
from copy import deepcopy
from importlib.resources import files
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.routing import APIRoute

from daq.uplink.wire import API
from fingermodel import comparing
from fingermodel.comparison.comparison import compare
from fingermodel.fingers.finger import Plane
from server.application.diagnosis_report import FIGURES as DIAGNOSIS
from server.figures.bench_finger import Hung, finger_figure
from server.figures.effect_change import effect_figure
from server.figures.effect_on_finger import effect_on_finger
from server.figures.shared_law import FIGURES as SHARED
from server.figures.style import NothingToDrawError
from server.service.answers import JsonAnswer, Tagged
from server.service.figures.answer import Theme, on_page, shown, shown_data, shown_or_why
from server.service.figures.comparison import Only, drawn_comparison
from server.service.figures.diagnosed import diagnosed, done_job
from server.service.figures.held_finger import held_finger
from server.service.figures.parts import about_of, cases_led_to, resolved, spread_members, spread_of
from server.service.figures.parts import settings_of as effect_settings
from server.service.jobs.studies import last_of, study_named
from server.service.schemas.common import InCase, Matched, ModelName, Posture, documented
from server.service.schemas.figures import FigureList, FigureShown
from server.service.services import Services, of
from server.service.sessions.blinding import blinded, require_closed, seen
from server.service.web.problems import ProblemError, not_found
from server.service.web.strict_requests import ReadingRoute

Draw = Callable[[], dict[str, Any]]

# Of each kind of figure what it needs, and the title of each by its name.
_LISTED: dict[str, dict[str, Any]] = json.loads((files("server.service.routes") / "figures.json").read_bytes())
COMPARISON = tuple(_LISTED["comparison"]["figures"])


router = APIRouter(route_class=ReadingRoute, prefix="/figures", tags=["figures"])

Name = Annotated[str, Path(max_length=100, description="Of the figure, as listed.")]
Effect = Annotated[
    str,
    Path(max_length=200, description="An effect, one of its candidates, or a parameter.", examples=["worn_pulley.FDP"]),
]
InSession = Annotated[str, Query(max_length=100, description="Id of the session.", examples=["DEV-01"])]
Before = Annotated[
    str | None, Query(max_length=200, description="A model that this one is held against; named as `model` is.")
]
InPlane = Annotated[
    Plane | None,
    Query(description="Force components: sagittal (x, y) or space; by default as the finger is judged."),
]
OfRole = Annotated[
    Literal["identification", "validation", "all"] | None,
    Query(
        description="Load cases of this role only; all: of both, on the finger too, which by default has validation."
    ),
]
AtMount = Annotated[Literal["tip", "bone"] | None, Query(description="Load cases with the cell at this place only.")]
InPosture = Annotated[str | None, Query(max_length=200, description="Load cases in this posture only.")]
WithMuscles = Annotated[
    str | None, Query(max_length=200, description="Load cases with these tendons loaded only, such as FDP+FDS.")
]
OfJob = Annotated[str, Query(max_length=200, description="Id of a diagnosis that is done.")]
OfSession = Annotated[str | None, Query(max_length=100, description="Which session of a pooled diagnosis.")]
AfterFit = Annotated[
    Literal["before", "after"],
    Query(
        description="Residuals after a refit with nothing added (before), or with what the verdict would add (after)."
    ),
]
WithoutEffect = Annotated[
    str | None,
    Query(max_length=200, description="An effect of the model: the case is drawn with its prediction without it, too."),
]
OfRevision = Annotated[str | None, Query(max_length=200, description="Id of a revision.")]
OfSpecimen = Annotated[str | None, Query(max_length=200, description="Or a specimen, whose revision is in force.")]
OnPage = Annotated[Theme, Query(description="Colours for a light or a dark page.")]

_DRAWN = documented(FigureShown) | {304: {"description": "Not Modified"}}


@router.get("", responses=documented(FigureList))
def listed() -> JsonAnswer:
    """List the figures: what each needs, and its query parameters."""
    rows = [_listed(kind, name) for kind, told in _LISTED.items() for name in told["figures"]]
    return JsonAnswer({"schema": "fingertwin/figures/1", "figures": rows})


@router.get("/comparison/{name}", responses=_DRAWN)
def comparison(
    name: Name,
    session: InSession,
    request: Request,
    model: ModelName = None,
    before: Before = None,
    plane: InPlane = None,
    role: OfRole = None,
    location: AtMount = None,
    posture: InPosture = None,
    muscles: WithMuscles = None,
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw predicted against measured forces: scatter, vectors at the finger, errors, residuals in uncertainties.

    While a bench is running, validation cases are left out. Vectors and bone are always drawn in the sagittal plane;
    with `before`, what that model predicted is drawn beside them.
    """
    only = Only(plane, role, location, posture, muscles)
    parts = of(request)
    _require(name, COMPARISON)
    measured = parts.measuring.of(session)
    named = resolved(parts, measured, model)
    earlier = resolved(parts, measured, before) if before is not None else None
    others = spread_members(parts, measured)
    key = ("comparison", name, measured.key, named, before is not None, earlier, only, tuple(o.key for o in others))

    def draw() -> dict[str, Any]:
        bench = parts.models.bench(measured, named)
        comparison = seen(measured, comparing.compare(bench))
        held = None
        if before is not None:
            other = parts.models.bench(measured, earlier)
            held = (other.loaded.name, other, seen(measured, comparing.compare(other)))
        about = about_of(measured, bench) | {"before": None if held is None else held[0]}
        spread = spread_of(parts, others, comparison)
        return shown_or_why(
            name,
            lambda: drawn_comparison(name, bench, comparison, only, held, spread),
            about,
            cases_led_to(measured),
        )

    return _answer(parts, key, theme, matched, draw)


@router.get("/diagnosis/{name}", responses=_DRAWN)
def diagnosis(
    name: Name,
    job: OfJob,
    request: Request,
    session: OfSession = None,
    fit: AfterFit = "before",
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw a figure of a diagnosis that is done."""
    parts = of(request)
    _require(name, DIAGNOSIS)
    session, answer, history = diagnosed(parts, job, session)

    def draw() -> dict[str, Any]:
        after = answer.get("where_after")
        seen = answer if fit == "before" or after is None else answer | {"where": after}
        drawing, caption = DIAGNOSIS[name]
        about = {"session": session, "model": answer.get("model"), "job": job}
        taken = {c["id"] for c in answer.get("cases", ())}
        known = [c for c in cases_led_to(parts.measuring.of(session)) if c.id in taken]
        return shown_or_why(name, lambda: (drawing(seen, history), caption), about, known)

    return _answer(parts, ("diagnosis", name, job, session, fit), theme, matched, draw)


@router.get("/shared/{name}", responses=_DRAWN)
def shared(name: Name, job: OfJob, request: Request, theme: OnPage = "light", matched: Matched = None) -> Response:
    """Draw what several sessions share beyond the catalogue: the curve by tendon and joint, and chance's part in it."""
    parts = of(request)
    _require(name, SHARED)
    _, answer = done_job(parts, job, ("pooled",), "a diagnosis of several sessions")
    for session in answer["sessions"]:
        require_closed(parts.measuring.of(session))

    def draw() -> dict[str, Any]:
        drawing, caption = SHARED[name]
        return shown_or_why(name, lambda: (drawing(answer), caption), {"job": job})

    return _answer(parts, ("shared", name, job), theme, matched, draw)


@router.get("/revisions/{name}", responses=_DRAWN)
def revisions(
    name: Name,
    request: Request,
    revision: OfRevision = None,
    specimen: OfSpecimen = None,
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw how the error fell with every step up to a revision, or to the one in force for a specimen."""
    parts = of(request)
    _require(name, _LISTED["revisions"]["figures"])
    if (revision is None) == (specimen is None):
        raise ProblemError(422, "not one of revision and specimen", "one of the two", "Add ?revision= or ?specimen=")
    if revision is None:
        revision = parts.revisions.in_force(specimen or "")
        if revision is None:
            raise not_found("revision of specimen", specimen or "", "/api/v1/specimens")
    found = parts.revisions.read(revision)

    def draw() -> dict[str, Any]:
        about = {"revision": found["id"], "specimen": found["specimen"], "session": found["session"]}
        drawing, caption = DIAGNOSIS["revisions"]
        return shown_or_why(name, lambda: (drawing({}, found["history"]), caption), about)

    return _answer(parts, ("revisions", name, revision), theme, matched, draw)


@router.get("/study/{study}/{name}", responses=_DRAWN)
def study(
    study: Annotated[str, Path(max_length=100, description="Of the study.", examples=["synek2019"])],
    name: Name,
    request: Request,
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw a figure of a published study as it was computed last."""
    parts = of(request)
    found = study_named(study)
    done = last_of(parts.jobs, found.name, done=True)
    if done is None or done.result is None:
        raise ProblemError(
            409, f"{study} was not computed yet", "a study that was", f"POST /api/v1/studies/{study}/reproductions"
        )
    figures = {f["name"]: f for f in done.result["figures"]}
    _require(name, list(figures))

    def draw() -> dict[str, Any]:
        return shown_data(name, deepcopy(figures[name]["figure"]), figures[name]["caption"], {"study": study})

    return _answer(parts, ("study", name, done.id), theme, matched, draw)


@router.get("/finger", responses=_DRAWN)
def finger(
    session: InSession,
    request: Request,
    posture: Posture = None,
    case: InCase = None,
    model: ModelName = None,
    without: WithoutEffect = None,
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw the finger in a posture with its tendons; of a load case with its weights, measured and predicted force.

    `layout.meta` tells the scale [mm/N], and where forces begin at tip and bone, for a live vector to be added. The
    prediction of a validation case is hidden until its session is closed.
    """
    parts = of(request)
    measured = parts.measuring.of(session)
    named = resolved(parts, measured, model)

    def draw() -> dict[str, Any]:
        held = held_finger(parts, measured, posture, case, named)
        figure = finger_figure(
            held.finger, held.finger.values, held.posture, held.angles, held.hung or Hung({}), held.loaded.id
        )
        if without is not None and case is not None and case not in blinded(measured):
            with suppress(NothingToDrawError):
                figure = effect_on_finger(parts.models.bench(measured, named), [without], case)
        caption = "Joint centres and tendon points are the model's; outlines, clamp and pulleys are schematic."
        about = {"session": session, "session_version": measured.record.version, "blinded": sorted(blinded(measured))}
        about |= {"model": held.loaded.id, "posture": held.posture, "case": held.hung and held.hung.case}
        return shown("finger", figure, caption, about, cases_led_to(measured))

    return _answer(parts, ("finger", measured.key, posture, case, named, without), theme, matched, draw)


@router.get("/effect/{effect}", responses=_DRAWN)
def effect(
    effect: Effect,
    session: InSession,
    request: Request,
    model: ModelName = None,
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw what an effect would change in a session's cases, at a typical size, beside what the model misses in them.

    Typical is the upper end of the plausible range; where there is none, a standard deviation of the prior; and what
    was fitted, where the model holds the effect. While a bench is running, validation cases are left out.
    """
    parts = of(request)
    measured = parts.measuring.of(session)
    named = resolved(parts, measured, model)
    own = parts.effects.named([effect])

    def draw() -> dict[str, Any]:
        bench = parts.models.bench(measured, named, own)
        title, settings = effect_settings(bench, effect, parts.models.found(named, measured))
        table, without = bench.model.parameters, bench.theta.copy()
        within = without.copy()
        for setting in settings:
            at = table.index[setting.name]
            without[at], within[at] = table.initial[at], setting.value
        before = seen(measured, compare(bench.model, bench.observations, without))
        after = seen(measured, compare(bench.model, bench.observations, within))
        held = any(setting.name in bench.loaded.added for setting in settings)
        about = about_of(measured, bench) | {"effect": effect, "parameters": [vars(s) for s in settings]}
        plane = bench.model.finger.judged_in
        caption = (
            f"Model: {bench.loaded.fitted}. The circles are what it misses with the effect taken out; bars that "
            "follow them take it up."
        )
        return shown_or_why(
            effect,
            lambda: (effect_figure(title, before, after, settings, plane=plane, held=held), caption),
            about,
            cases_led_to(measured),
        )

    return _answer(parts, ("effect", effect, measured.key, named), theme, matched, draw)


def _answer(parts: Services, key: Hashable, theme: Theme, matched: str | None, draw: Draw) -> Response:
    """Answer with a figure that is kept already, or is drawn now and kept."""
    kept = parts.drawn.of((key, theme), lambda: Tagged.of(on_page(draw(), theme) | {"theme": theme}))
    return kept.answer(matched)


def _require(name: str, known: Collection[str]) -> None:
    if name not in known:
        raise not_found("figure", name, f"/api/v1/figures: {', '.join(known)}")


def _listed(kind: str, name: str) -> dict[str, object]:
    """Return a line of the list; its query parameters are those of its route."""
    at = f"{router.prefix}/{kind}"
    routes = (r for r in router.routes if isinstance(r, APIRoute))
    route = next(r for r in routes if f"{r.path}/".startswith(f"{at}/"))
    return {
        "kind": kind,
        "name": name,
        "title": _LISTED[kind]["figures"][name],
        "needs": _LISTED[kind]["needs"],
        "path": f"{API}{at}" if route.path == at else f"{API}{at}/{name}",
        "parameters": [
            {"name": p.alias, "required": p.field_info.is_required(), "description": p.field_info.description}
            for p in route.dependant.query_params
        ],
    }
