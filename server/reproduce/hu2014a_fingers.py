"""The fingers that stand in for the study's, and both of its models at the measured loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fingermodel.fingers.files import read_finger
from fingermodel.inverse.pressing import pressing_forces, pressing_posture, pressing_wrench
from fingermodel.model import jax_values, posture_moment_arms, tip_kinematics_batch
from fingermodel.scaling import match_moment_arms

if TYPE_CHECKING:
    from fingermodel.fingers import Finger

COLUMNS = ("extensor", "flexor", "radial", "ulnar", "DIP", "PIP", "MCP")
MODELS = {"minimal": "no hood", "chao": "hood"}
PUBLISHED = {"minimal": "minimal", "chao": "full"}


@dataclass(frozen=True)
class Pressed:
    """Both models at one load, per newton, columns as in `COLUMNS`."""

    name: str  # of the load
    postures: tuple[int, ...]  # of the study that it stands for
    forces: dict[str, dict[str, float]]  # model → column → force
    push: dict[str, tuple[str, ...]]  # model → muscles that it asks to push

    @property
    def title(self) -> str:
        """Such as `posture 1` or `postures 2 and 3`."""
        return f"posture{'s' * (len(self.postures) > 1)} {' and '.join(map(str, self.postures))}"

    def change_pct(self, column: str) -> float:
        """Change of a force with the hood [%] of the one without."""
        without = self.forces["minimal"][column]
        return 100.0 * (self.forces["chao"][column] - without) / without

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {"load": self.name, "postures": self.postures, "forces": self.forces, "push": self.push}


def index_finger(published: dict[str, Any]) -> Finger:
    """Return An's index finger, pressed at the end of the distal phalanx."""
    return read_finger("an1979_index").replace_values(load_point=[-published["distal_phalanx_mm"], 0.0, 0.0])


def pressed(finger: Finger, published: dict[str, Any]) -> list[Pressed]:
    """Return both models at the three loads."""
    out = []
    for load in published["loads"]:
        forces, push = {}, {}
        for model in MODELS:
            answer = pressing_forces(finger, load["theta_deg"], load["force_N"], model)
            m = answer.muscle
            flexor, extensor = ("PF", "PE") if model == "minimal" else ("FDP", "EDC")
            forces[model] = {
                "extensor": m[extensor],
                "flexor": m[flexor],
                "radial": m["RI"] + m.get("LU", 0.0),
                "ulnar": m["UI"],
                **answer.contact,
            }
            push[model] = answer.push
        out.append(Pressed(load["name"], tuple(load["postures"]), forces, push))
    return out


def with_fitted_flexor(finger: Finger, published: dict[str, Any]) -> Finger:
    """Return the finger with its flexor moved so that the minimal model has the printed PE and PF in posture 1.

    Two numbers (FDP's moment arms at DIP and PIP) are fitted to two; all else is then a prediction.
    """
    load = published["loads"][0]
    needed = needed_arms(finger, load, means(published, "minimal", (1,)))
    posture = pressing_posture(finger.topology, load["theta_deg"])
    return match_moment_arms(finger, {f"{joint}.FDP": arm for joint, arm in needed.items()}, [posture])


def with_fitted_terminal_slip(finger: Finger, published: dict[str, Any]) -> Finger:
    """Return the finger with its terminal slip moved so that the minimal model has the printed PF in posture 1.

    One number (TE's moment arm at the DIP) is fitted to one; all else, in all postures, is then a prediction.
    """
    load = published["loads"][0]
    flexor = means(published, "minimal", (1,))["flexor"]
    arms, demand, size = moments(finger, load)
    extensor = (demand["PIP"] / size - flexor * arms["PIP", "FDP"]) / arms["PIP", "ES"]
    wanted = (demand["DIP"] / size - flexor * arms["DIP", "FDP"]) / extensor
    return match_moment_arms(finger, {"DIP.TE": wanted}, [pressing_posture(finger.topology, load["theta_deg"])])


def needed_arms(finger: Finger, load: dict[str, Any], mean: dict[str, float]) -> dict[str, float]:
    """Return the arms of PF at DIP and PIP [mm] with which printed PF and PE balance a load; PE's are the finger's."""
    arms, demand, size = moments(finger, load)
    out = {}
    for joint, slip in (("DIP", "TE"), ("PIP", "ES")):
        out[joint] = (demand[joint] / size - mean["extensor"] * arms[joint, slip]) / mean["flexor"]
    return out


def moments(finger: Finger, load: dict[str, Any]) -> tuple[dict[tuple[str, str], float], dict[str, float], float]:
    """Return flexion moment arms by joint and slip [mm], flexion moments the load asks for [N mm], and its size [N]."""
    import jax.numpy as jnp

    topology = finger.topology
    posture = pressing_posture(topology, load["theta_deg"])
    values = jax_values(finger.values)
    table = np.asarray(posture_moment_arms(topology, values, jnp.asarray(posture)))
    jacobian = np.asarray(tip_kinematics_batch(topology, values, jnp.asarray(posture)[None]).jacobian[0])
    torque = jacobian.T @ pressing_wrench(load["theta_deg"], load["force_N"])
    rotations = topology.rotations
    arms = {(s.joint, s.slip): float(table[rotations.index(s.joint), i]) for i, s in enumerate(topology.segments)}
    return arms, dict(zip(rotations, torque.tolist(), strict=True)), float(np.linalg.norm(load["force_N"]))


def means(published: dict[str, Any], model: str, postures: tuple[int, ...]) -> dict[str, float]:
    """Return printed mean of each column, over postures."""
    table = published[PUBLISHED.get(model, model)]
    return {c: float(np.mean([float(table[p - 1][i][0]) for p in postures])) for i, c in enumerate(COLUMNS)}
