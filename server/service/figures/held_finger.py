"""The finger of a session in a posture, with the weights of a load case and the forces that may be seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from daq.signals.tension_estimate import PUBLISHED_TENSION_FACTOR
from fingermodel.comparing import compare
from fingermodel.comparison.observations import posture_rad
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.model_files import Revision
from fingermodel.predicting import Predictor
from server.figures.bench_finger import Hung
from server.service.services import Services
from server.service.sessions.blinding import HIDDEN
from server.service.sessions.measuring import Measured
from server.service.web.problems import ProblemError, not_found

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeldFinger:
    """A finger as it is held."""

    document: Mapping[str, Any]  # of the session
    loaded: Finger | Revision  # the model
    finger: Finger  # of that model
    posture: str  # its name
    angles: Floats  # (rotations,) of the posture [rad]
    hung: Hung | None  # load case that is shown; None for the finger alone


def held_finger(
    parts: Services, measured: Measured, posture: str | None, case: str | None, model: str | None
) -> HeldFinger:
    """Put together what a drawing of the finger shows.

    Args:
        parts: of the service.
        measured: the session.
        posture: its name; by default that of the case.
        case: taken or planned; None for the finger alone.
        model: a revision, a finger that comes with the software, or None for the session's own finger.

    Raises:
        InputError: the posture or the model cannot be used.
        ProblemError: 404 there is no such posture or case, 409 nothing is known of the session yet, 422 neither is
            given, or they do not belong together.
    """
    name, document, postures = measured.record.id, measured.record.require_document(), measured.record.postures_deg
    wanted, found = (posture, None) if case is None else _case(measured, case)
    if posture not in (None, wanted):
        raise ProblemError(422, f"case {case} in another posture", f"posture {wanted}, or none")
    if wanted is None:
        raise ProblemError(422, "neither posture nor case", "one of the two")
    if wanted not in postures:
        raise not_found("posture", wanted, f"/api/v1/sessions/{name}/document")
    loaded = _model(parts, measured, model)
    finger = loaded if not hasattr(loaded, "finger") else loaded.finger
    angles = posture_rad(finger.topology, postures[wanted], f"posture {wanted}")
    hung = None if found is None else _hung(parts, measured, found, model, loaded, angles)
    return HeldFinger(document, loaded, finger, wanted, angles, hung)


def _model(parts: Services, measured: Measured, model: str | None) -> Finger | Revision:
    """Return the model that a drawing is asked for with; by default the session's own finger."""
    found = parts.models.model(model, measured)
    if found is None:
        # Only a name that comes with the software is left here.
        found = str((measured.record.document or {}).get("finger"))
    return read_finger(found) if isinstance(found, str) else found


def _case(measured: Measured, case: str) -> tuple[str, Hung]:
    """Return the posture and the weights of a load case that was taken, or is planned.

    Raises:
        ProblemError: 404 there is none.
    """
    record = measured.record
    for taken in record.amended_cases:
        if taken["id"] == case:
            masses = dict(taken.get("masses_g") or {})
            return str(taken.get("posture")), Hung(masses, str(taken.get("location")), case, str(taken.get("role")))
    for planned in () if record.bench is None else record.bench.setup.cases():
        if planned.id == case:
            return planned.posture, Hung(dict(planned.masses_g), str(planned.location), case, str(planned.role))
    raise not_found("case", case, f"/api/v1/sessions/{record.id}/cases")


def _hung(
    parts: Services, measured: Measured, case: Hung, model: str | None, loaded: Finger | Revision, angles: Floats
) -> Hung:
    """Return the weights of a case, with the forces that may be seen."""
    force = measured.force(case.case) or {"measured_N": None, "measured_sd_N": None}
    blind = case.role == "validation" and not measured.record.closed
    predicted, note = None, HIDDEN if blind else ""
    if not blind:
        try:
            predicted = _predicted(parts, measured, case, model, loaded, angles)
        except InputError as error:
            note = f"No prediction: {error}"
    measured_N, sd_N = (None if v is None else np.array(v) for v in (force["measured_N"], force["measured_sd_N"]))
    return replace(case, measured_N=measured_N, measured_sd_N=sd_N, predicted_N=predicted, note=note)


def _predicted(
    parts: Services, measured: Measured, case: Hung, model: str | None, loaded: Finger | Revision, angles: Floats
) -> Floats | None:
    """Predict the force on the cell: of a measured case as the comparison does, of others from what will hang."""
    if measured.force(case.case) is not None:
        cases = compare(parts.models.bench(measured, model)).cases
        return next((np.asarray(c.predicted_N) for c in cases if c.id == case.case), None)
    document = measured.record.document or {}
    factor = document.get("tension_factor")
    stated = float(factor) if isinstance(factor, int | float) else PUBLISHED_TENSION_FACTOR
    weight = float(document.get("gravity_m_s2", 9.81)) * 1e-3 * stated
    predictor = Predictor(loaded)
    unknown = [m for m in case.masses_g if m not in predictor.topology.muscles]
    if unknown:
        return None
    hung = np.array([[float(case.masses_g.get(m, 0.0)) for m in predictor.topology.muscles]])
    forces = predictor.predict(angles[None], hung * weight, weight)
    force = forces["tip_force_N" if case.location == "tip" else "bone_force_N"][0]
    return force if np.isfinite(force).all() else None
