"""Figures as Plotly JSON: comparisons, diagnoses, the fall of the error, the finger at the bench, effects."""

from __future__ import annotations

import threading
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.routing import APIRoute

from daq.uplink.wire import API
from server.service.answers import JsonAnswer
from server.service.figures.answer import Theme
from server.service.figures.comparison import Only, Plane
from server.service.figures.diagnosed import DIAGNOSIS
from server.service.figures.figures import COMPARISON, REVISIONS, SHARED, Figures, SearchFit
from server.service.schemas.common import ModelName, documented
from server.service.schemas.figures import EXAMPLE, FigureList, FigureShown
from server.service.services import of
from server.service.web.strict_requests import ReadingRoute

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
Posture = Annotated[
    str | None, Query(max_length=200, description="A posture of the session; by default that of the case.")
]
InCase = Annotated[
    str | None,
    Query(alias="case", max_length=100, description="A load case, taken or planned; else the finger alone."),
]
OfJob = Annotated[str, Query(max_length=200, description="Id of a diagnosis that is done.")]
OfSession = Annotated[str | None, Query(max_length=100, description="Which session of a pooled diagnosis.")]
AfterFit = Annotated[
    SearchFit,
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
Matched = Annotated[str | None, Header(alias="If-None-Match", max_length=200)]

_DRAWN = documented(FigureShown, example=EXAMPLE) | {304: {"description": "Not Modified"}}
_LOCK = threading.Lock()

_NEEDS = {
    "comparison": "Measured load cases; while a bench is running, identification cases alone are shown.",
    "diagnosis": "A job of kind diagnose or pooled that is done.",
    "shared": "A job of kind pooled that is done.",
    "revisions": "A revision.",
    "finger": "A session with postures; a load case for weights and forces.",
    "effect": "Measured load cases, and an effect of GET /api/v1/effects; while a bench is running, identification "
    "alone.",
    "study": "A study of GET /api/v1/studies that was computed.",
}
_TITLES = {
    "scatter": "Measured and predicted force components, identification cases",
    "scatter_validation": "Measured and predicted force components, validation cases",
    "vectors": "Tip forces in each posture",
    "bone": "Net forces on the metacarpal",
    "errors": "Errors by tendon, posture and role",
    "z": "Residual of every case against its measurement uncertainty",
    "sensitivity": "Sensitivity analysis: the verdict's probability under each assumption",
    "residual_map": "Where the model fails, by tendon and posture",
    "missing_torque": "The joint torque that is missing",
    "ranking": "Which explanation, with probabilities",
    "size": "Size of the effect, by load, posture and mount",
    "confounding": "What cannot be told apart",
    "revisions": "Error before and after",
    "held_out": "Residuals of the validation cases, before and after",
    "own_curve": "What no effect explains, as a smooth error by tendon and joint",
    "shared_curve": "What several sessions share beyond the catalogue, by tendon and joint",
    "shared_chance": "Whether chance would do as well",
    "shared_law": "The best law against the shared curve, by tendon and joint",
    "waterfall": "The fall of the error, step by step",
    "finger": "The finger in a posture, with weights and forces",
    "{effect}": "What an effect would change in a session's cases",
    "{study}/{name}": "A figure of a published study",
}


def figures_of(request: Request) -> Figures:
    """Return the service's figures, made with the first request for one."""
    parts, state = of(request), request.app.state
    with _LOCK:
        found: Figures | None = getattr(state, "figures", None)
        if found is None or found.parts is not parts:
            found = state.figures = Figures(parts)
    return found


@router.get("", responses=documented(FigureList))
def listed() -> JsonAnswer:
    """List the figures: what each needs, and its query parameters."""
    rows = [_listed(k, n) for k, names in _names().items() for n in names]
    return JsonAnswer({"figures": rows})


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
    return figures_of(request).comparison(name, session, model, before, only, theme).answer(matched)


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
    return figures_of(request).diagnosis(name, job, session, fit, theme).answer(matched)


@router.get("/shared/{name}", responses=_DRAWN)
def shared(name: Name, job: OfJob, request: Request, theme: OnPage = "light", matched: Matched = None) -> Response:
    """Draw what several sessions share beyond the catalogue: the curve by tendon and joint, and chance's part in it."""
    return figures_of(request).shared(name, job, theme).answer(matched)


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
    return figures_of(request).revisions(name, revision, specimen, theme).answer(matched)


@router.get("/study/{study}/{name}", responses=_DRAWN)
def study(
    study: Annotated[str, Path(max_length=100, description="Of the study.", examples=["synek2019"])],
    name: Name,
    request: Request,
    theme: OnPage = "light",
    matched: Matched = None,
) -> Response:
    """Draw a figure of a published study as it was computed last."""
    return figures_of(request).study(study, name, theme).answer(matched)


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
    return figures_of(request).finger(session, posture, case, model, without, theme).answer(matched)


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
    return figures_of(request).effect(effect, session, model, theme).answer(matched)


def _names() -> dict[str, tuple[str, ...]]:
    named = {"comparison": COMPARISON, "diagnosis": DIAGNOSIS, "shared": SHARED, "revisions": REVISIONS}
    return named | {"finger": ("finger",), "effect": ("{effect}",), "study": ("{study}/{name}",)}


def _listed(kind: str, name: str) -> dict[str, object]:
    """Return a line of the list; its query parameters are those of its route."""
    at = f"{router.prefix}/{kind}"
    routes = (r for r in router.routes if isinstance(r, APIRoute))
    route = next(r for r in routes if f"{r.path}/".startswith(f"{at}/"))
    return {
        "kind": kind,
        "name": name,
        "title": _TITLES.get(name, name),
        "needs": _NEEDS[kind],
        "path": f"{API}{at}" if route.path == at else f"{API}{at}/{name}",
        "parameters": [
            {"name": p.alias, "required": p.field_info.is_required(), "description": p.field_info.description}
            for p in route.dependant.query_params
        ],
    }
