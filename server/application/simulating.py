"""A session as the rig would record it of a known finger, with the truth beside it."""

from __future__ import annotations

import json
from pathlib import Path

from daq.errors import InputError
from daq.sessions.models import Session
from daq.sessions.protocols import read_protocol
from daq.standins.simulated import SimulatedCell
from fingermodel.fingers.files import read_finger
from fingermodel.model_files import read_revision
from fingermodel.rig import simulate_session


def simulate_session_at(
    protocol: str, out: Path, model: str, rate_hz: float, noise_N: float, repeats: int, seed: int
) -> Session:
    """Write a simulated session, and the true wrenches [N, N mm] into `truth.json` beside it.

    Args:
        protocol: name or file of a loading protocol.
        out: a new folder.
        model: a finger, or the file of a revision, whose finger is taken.
        rate_hz: readings a second.
        noise_N: standard deviation of a reading's force [N]; seven times as much of its torque [N mm].
        repeats: of the protocol.
        seed: of the noise.

    Raises:
        InputError: a number out of range, a folder that is not empty, or a protocol or model that cannot be read.
    """
    if not 0 < rate_hz <= 1e6 or not 0 <= noise_N <= 1e3 or repeats < 1 or seed < 0:
        raise InputError(
            f"rate {rate_hz:g} Hz, noise {noise_N:g} N, {repeats} repeats, seed {seed}",
            "a rate above 0 and up to 1e6, noise of 0 to 1000, 1 repeat or more, a seed of 0 or more",
        )
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is not empty", "a new folder", "Choose another --out")
    finger = read_revision(Path(model)).finger if Path(model).suffix == ".json" else read_finger(model)
    cell = SimulatedCell(rate_hz=rate_hz, noise_sd=(noise_N,) * 3 + (noise_N * 7.0,) * 3)
    session, truth = simulate_session(
        finger, read_protocol(protocol), out, cell=cell, seed=seed, session_id=out.resolve().name, repeats=repeats,
        finger_name=None if Path(model).suffix != ".json" else finger.document["id"],
    )  # fmt: skip
    wrenches = {name: [round(float(x), 6) for x in wrench] for name, wrench in truth.items()}
    (out / "truth.json").write_text(json.dumps({"id": session.id, "wrench_N_Nmm": wrenches}, indent=1) + "\n")
    return session
