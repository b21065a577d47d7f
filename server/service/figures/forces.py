"""Forces inside the finger, worked out for one answer and kept as long as what they came from is the same."""

from __future__ import annotations

from typing import Any

from fingermodel.dynamics.motion import motion_from_dict, motion_names, read_motion
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.muscles.muscle_files import muscle_set_names, read_muscles
from fingermodel.studies.activation import activate
from fingermodel.studies.inversion import invert_bench
from fingermodel.studies.movement import work_out
from server.figures.activation import activation_plots
from server.figures.inversion import inversion_plots
from server.figures.movement import movement_plots
from server.service.figures.answer import Theme, drawn_plots
from server.service.figures.fingers import finger_shown, known_finger
from server.service.figures.parts import resolved
from server.service.services import Services
from server.service.sessions.blinding import require_closed
from server.service.web.problems import not_found


def invertible(parts: Services, session: str, closure: str, model: str | None, theme: Theme | None) -> dict[str, Any]:
    """Invert a session, and draw what came of it where a theme is named.

    Raises:
        InputError: no case that can be inverted, or a finger that the closure does not fit.
        ProblemError: 404 there is no such session, 409 its bench is still running, 422 there is no such model.
    """
    measured = parts.measuring.of(session)
    require_closed(measured)
    bench = parts.models.bench(measured, resolved(parts, measured, model))
    found = invert_bench(bench, closure)
    drawn = [] if theme is None else drawn_plots(inversion_plots(found), theme)
    head = {"schema": "fingertwin/invert/1"} | parts.models.provenance(measured, bench)
    return head | found.as_dict() | {"sentences": found.verdicts(), "figures": drawn}


def movement_choices() -> dict[str, list[str]]:
    """Return the choices for a movement."""
    fingers = [name for name in finger_names() if finger_shown(name)["moves"]]
    return {"motions": motion_names(), "muscles": muscle_set_names(), "fingers": fingers}


def movement(asked: dict[str, Any], theme: Theme | None) -> dict[str, Any]:
    """Work out a movement, and draw it where a theme is named.

    Args:
        asked: motion or document, finger, muscles, steps.
        theme: of the page; None for no figures.

    Raises:
        InputError: a document that cannot be used, or torques beyond the muscles' strength.
        ProblemError: 404 there is no such movement, finger or muscle set.
    """
    known = movement_choices()
    if asked["muscles"] not in known["muscles"]:
        raise not_found("muscle set", asked["muscles"], "/api/v1/movements")
    if asked["document"] is None and asked["motion"] not in known["motions"]:
        raise not_found("movement", asked["motion"], "/api/v1/movements")
    finger = read_finger(known_finger(asked["finger"]))
    motion = (
        read_motion(asked["motion"]) if asked["document"] is None else motion_from_dict(asked["document"], "document")
    )
    result = work_out(motion, finger, read_muscles(asked["muscles"], finger), asked["steps"])
    drawn = [] if theme is None else drawn_plots(movement_plots(result), theme)
    return {"schema": "fingertwin/move/1"} | result.as_dict() | {"figures": drawn}


def activation(asked: dict[str, Any], theme: Theme | None) -> dict[str, Any]:
    """Hold a finger with its muscles active, and draw it where a theme is named.

    Args:
        asked: finger, muscles, posture_deg, activation, force_N, lost.
        theme: of the page; None for no figures.

    Raises:
        InputError: a muscle, joint or direction that is not known, or a force beyond the muscles' strength.
        ProblemError: 404 there is no such finger or muscle set.
    """
    finger, muscles = known_finger(asked.pop("finger")), asked.pop("muscles")
    if muscles is not None and muscles not in muscle_set_names():
        raise not_found("muscle set", muscles, "/api/v1/movements")
    found = activate(finger, muscles, **asked)
    drawn = [] if theme is None else drawn_plots(activation_plots(found), theme)
    return {"schema": "fingertwin/activate/1"} | found.as_dict() | {"figures": drawn}
