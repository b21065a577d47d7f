"""A finger and a rig drawn from the certificate's priors, and the session that they would record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from daq.sessions.protocols import read_protocol
from daq.standins.simulated import SimulatedCell
from fingermodel.budget import CERTIFICATE
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.model import Model
from fingermodel.rig import simulate_session
from fingermodel.stages import Layout

Floats = NDArray[np.float64]
CELL = SimulatedCell(rate_hz=25.0, noise_sd=(0.03,) * 3 + (0.2,) * 3)
POSTURES = ("minor_flexion", "major_flexion", "hook", "hyperextension", "relaxed")
LAYOUT = Layout(tuple((p, 0) for p in POSTURES), (("tip", 0), ("bone", 0)))


def perturbed(seed: int) -> tuple[Finger, dict[str, float]]:
    """A finger and a rig drawn from the certificate's priors, and the value of every parameter."""
    rng = np.random.default_rng(seed)
    model = Model(read_finger("an1979_middle"), LAYOUT, CERTIFICATE)
    table = model.parameters
    theta = np.clip(table.centre + rng.normal(size=len(table)) * table.sd, table.lower, table.upper)
    finger = model.finger.replace_values(**model.values_at(theta)._asdict())
    return finger, dict(zip(table.names, theta.tolist(), strict=True))


def record(folder: Path, seed: int) -> tuple[dict[str, float], dict[str, Floats]]:
    """Write the session of such a rig; return the value of every parameter, and every case's wrench (6,)."""
    finger, truth = perturbed(seed)
    rig = {name: value for name, value in truth.items() if not name.startswith(("point", "fraction"))}
    protocol = read_protocol("levels")
    _, wrenches = simulate_session(
        finger, protocol, folder, cell=CELL, seed=seed, finger_name="an1979_middle", truth=rig
    )
    return truth, wrenches


def misstate(file: Path, seed: int, scatter: float, hanger_g: float = 0.0) -> None:
    """State other masses in a session's file than hung: they scatter, and nobody weighed the hangers."""
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    rng = np.random.default_rng(seed)
    for case in document["cases"]:
        hung = {m: g * float(np.exp(scatter * rng.normal())) for m, g in case["masses_g"].items()}
        case["masses_g"] = {m: max(g - hanger_g, 1.0) for m, g in hung.items()}
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
