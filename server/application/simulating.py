"""A session as the rig would record it of a known finger and its effects, with the truth beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.sessions.models import Session
from daq.sessions.protocols import read_protocol
from daq.standins.simulated import SimulatedCell
from fingermodel.budget import CERTIFICATE
from fingermodel.fingers.files import read_finger
from fingermodel.model_files import load_model, read_revision
from fingermodel.rig import rig_model, simulate_session
from fingermodel.session import held_effects
from fingermodel.stages import Effect
from fingermodel.structure import ANY_LAYOUT


def simulate_session_at(
    protocol: str,
    out: Path,
    model: str,
    effects: Mapping[str, float],
    rate_hz: float,
    noise_N: float,
    repeats: int,
    seed: int,
) -> tuple[Session, dict[str, Any]]:
    """Write a simulated session, and its truth into `truth.json` beside it.

    Args:
        protocol: name or file of a loading protocol.
        out: a new folder.
        model: a finger, or the file of a revision, whose finger and effects act; errors of its rig do not.
        effects: values of effects' parameters by name, each in its own unit; they precede those of a revision.
        rate_hz: readings a second.
        noise_N: standard deviation of a reading's force [N]; seven times as much of its torque [N mm].
        repeats: of the protocol.
        seed: of the noise.

    Returns:
        The session; and the truth: `model`, `parameters` that act (name, value, unit), `left_out` (names of a
        revision's parameters that mean nothing in this protocol), and `wrench_N_Nmm` without noise by case.

    Raises:
        InputError: a number out of range, a folder that is not empty, a protocol or model that cannot be read, or a
            parameter that the rig lacks.
    """
    if not 0 < rate_hz <= 1e6 or not 0 <= noise_N <= 1e3 or repeats < 1 or seed < 0:
        raise InputError(
            f"rate {rate_hz:g} Hz, noise {noise_N:g} N, {repeats} repeats, seed {seed}",
            "a rate above 0 and up to 1e6, noise of 0 to 1000, 1 repeat or more, a seed of 0 or more",
        )
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is not empty", "a new folder", "Choose another --out")
    planned = read_protocol(protocol)
    revision = read_revision(Path(model)) if Path(model).suffix == ".json" else None
    finger = revision.finger if revision else read_finger(model)
    held: tuple[Effect, ...] = ()
    if revision or effects:
        # A rig without any effect needs no model of them.
        loaded = load_model(revision or finger, "", finger.id, None, ANY_LAYOUT, CERTIFICATE, held_effects())
        held = loaded.model.effects
    parameters = rig_model(finger, planned, held).parameters
    fitted = revision.effects if revision else {}
    acting = {name: value for name, value in fitted.items() if name in parameters.index} | dict(effects)
    session, wrenches = simulate_session(
        finger, planned, out, cell=SimulatedCell(rate_hz=rate_hz, noise_sd=(noise_N,) * 3 + (noise_N * 7.0,) * 3),
        seed=seed, session_id=out.resolve().name, repeats=repeats, effects=held, truth=acting,
        finger_name=finger.document["id"] if revision else None,
    )  # fmt: skip
    truth = {
        "id": session.id,
        "model": revision.id if revision else finger.id,
        "parameters": [
            {"name": name, "value": value, "unit": parameters.parameters[parameters.index[name]].unit}
            for name, value in acting.items()
        ],
        "left_out": [name for name in fitted if name not in acting],
        "wrench_N_Nmm": {name: [round(float(x), 6) for x in wrench] for name, wrench in wrenches.items()},
    }
    (out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    return session, truth
