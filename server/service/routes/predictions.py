"""Predictions of any finger, posture and load; comparisons of sessions with models; friction by force balance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Request, Response

from daq.errors import InputError
from daq.findings import warnings_by_session
from daq.signals.friction import friction as balance
from fingermodel.predicting import Predictor
from fingermodel.predicting import predict as evaluate
from server.service.answers import JsonAnswer
from server.service.schemas.common import Matched, ModelName, SessionId, documented
from server.service.schemas.predictions import Asked, Compared, Friction, Predicted
from server.service.services import of
from server.service.web.problems import ProblemError
from server.service.web.strict_requests import AskingRoute

router = APIRouter(route_class=AskingRoute, tags=["comparison"])


@router.post("/predictions", responses=documented(Predicted))
def predict(body: Asked, request: Request) -> JsonAnswer:
    """Predict the forces of load cases, many at once or one alone."""
    predictor = of(request).models.predictor(body.model)
    _require_all_joints(body.postures_deg, predictor)
    forces = evaluate(
        predictor,
        body.postures_deg,
        body.masses_g,
        tensions_N=body.tensions_N,
        tension_factor=body.tension_factor,
        gravity_m_s2=body.gravity_m_s2,
    )
    undetermined = np.flatnonzero(np.isnan(forces.tip_force_N[:, 0]))
    answer = {k: np.ascontiguousarray(v) for k, v in vars(forces).items()}
    head = {"schema": "fingertwin/predict/1", "model": predictor.name, "n": len(forces)}
    return JsonAnswer(head | answer | {"undetermined": undetermined})


def _require_all_joints(postures_deg: Mapping[str, object], predictor: Predictor) -> None:
    """Refuse postures that leave a joint of the finger open, other than an abduction, which is 0 then."""
    joints = predictor.topology.rotations
    needed = [j for j in joints if not j.endswith("abduction")]
    lacking = [j for j in needed if j not in postures_deg]
    if lacking and set(postures_deg) <= set(joints):
        raise InputError(
            f"postures_deg lacks {' and '.join(lacking)}",
            f"an angle for each joint of {predictor.name}: {', '.join(needed)}",
            "Give 0 for a joint that is straight",
        )


@router.get("/sessions/{session}/comparison", responses=documented(Compared) | {304: {"description": "Not Modified"}})
def compare(session: SessionId, request: Request, model: ModelName = None, matched: Matched = None) -> Response:
    """Compare predicted with measured forces, per load case and summarised.

    While a bench is running, validation cases are left out. An answer that the client has already is not sent again
    (`If-None-Match`).
    """
    return of(request).models.comparison(session, model).answer(matched)


@router.get("/friction", tags=["friction"], responses=documented(Friction))
def friction(
    request: Request,
    session: Annotated[list[str], Query(min_length=1, max_length=50, description="One or more sessions.")],
) -> JsonAnswer:
    """Find the friction factor by force balance (Synek et al. 2019, Eq 1): per case, specimen and pooled."""
    if len(set(session)) < len(session):
        raise ProblemError(422, "a session twice", "each session once", "Name it once")
    parts = of(request)
    found, warned = [], []
    for name in session:
        measured = parts.measuring.of(name)
        if not measured.record.closed:
            raise ProblemError(
                409,
                f"session {name} is still running",
                "a session that its bench has closed",
                "Close it at the bench first",
            )
        found.append(measured.require())
        warned.append((name, measured.findings))
    body = balance(found).as_dict() | {"warnings": warnings_by_session(warned)}
    return JsonAnswer({"schema": "fingertwin/friction/1"} | body)
