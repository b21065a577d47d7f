"""A finger with an elastic hood, one whose hood is a rhombus, and how they share."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import yaml
from hypothesis import strategies as st
from numpy.typing import NDArray

from daq.locations import data_dir
from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_from_dict, read_finger
from fingermodel.hood.parts import ElasticHood
from fingermodel.hood.sharing import bone_lengths
from fingermodel.kinematics import joint_poses
from fingermodel.model import jax_values

Floats = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)
CASES = 16
FINGER = read_finger("synek2019_network")
assert isinstance(FINGER.topology.hood, ElasticHood)
HOOD = FINGER.topology.hood
NETWORK = HOOD.network


@partial(jax.jit, static_argnums=0)
def segments_of(topology: Any, values: Any, tension: jax.Array, posture: jax.Array) -> jax.Array:
    return segment_tensions(topology, values, tension, joint_poses(topology, values, posture))


def shared(finger: Finger, tension: Floats, posture: Floats | None = None) -> Floats:
    q = np.array([0.0, 0.2, 0.6, 0.3]) if posture is None else posture
    return np.asarray(segments_of(finger.topology, jax_values(finger.values), jnp.asarray(tension), jnp.asarray(q)))


def document_of(name: str) -> dict[str, Any]:
    text = (data_dir() / "fingers" / f"{name}.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.safe_load(text)
    return document


def rhombus(base: Finger, stiffness: float) -> tuple[Finger, dict[str, float]]:
    """`base` with a forked network, and the fractions of Winslow's rhombus that this one tends to."""
    a_long, g_long, d_long, f_long, side = 0.2, 0.5, 0.2, 0.4, 0.2
    own = {"source": "us", "certainty": "assumed"}

    def node(name: str, bone: str, along: float, around: float, slides: list[float]) -> dict[str, Any]:
        return {"name": name, "bone": bone, "along": along, "around": around, "slides_deg": slides} | own

    def spring(a: str, b: str, k: float) -> dict[str, Any]:
        return {"name": f"{a}-{b}", "ends": [a, b], "stiffness_N_per_mm": k} | own

    lengths = np.asarray(bone_lengths(base.topology, jax_values(base.values)))
    pp, mp = lengths[1], lengths[2]
    wide = 2.0 * side * pp / mp
    nodes = [node("A", "PP", a_long, 0.0, [0.0]), node("D", "MP", d_long, 0.0, []), node("E0", "DP", 0.1, 0.0, [])]
    nodes += [node("G", "PP", g_long, side, [0.0, 90.0]), node("M", "PP", g_long, -side, [0.0, 90.0])]
    nodes += [node("F", "MP", f_long, wide, [0.0]), node("L", "MP", f_long, -wide, [0.0])]
    forks = [spring(a, b, stiffness) for a, b in ("AD", "AF", "AL", "GD", "GF", "MD", "ML")]
    trunks = [spring("F", "E0", stiffness**2), spring("L", "E0", stiffness**2)]
    roles = {"central_slip": ["A-D", "G-D", "M-D"], "radial_band": ["A-F", "G-F"], "ulnar_band": ["A-L", "M-L"]}
    network = {
        "format": "hood/1",
        "id": "rhombus",
        "title": "a rhombus",
        "sources": {"us": "ours"},
        "bones": ["PP", "MP", "DP"],
        "nodes": nodes,
        "springs": [*forks, *trunks],
        "tether": {"stiffness_N_per_mm": 1e-6} | own,
        "delivers": roles | {"terminal_slip": ["F-E0", "L-E0"]},
    }
    document = document_of("an1979_middle")
    slips = {k: v for k, v in document["hood"].items() if k.endswith(("slip", "band"))}
    number = {"value": 1.0, "source": "fingertwin", "certainty": "assumed"}
    pulls = {"RI": "G", "LU": "G", "UI": "M", "EDC": "A"}
    document["hood"] = {"kind": "elastic_network", "network": network, "pulls": pulls, "fractions": {"follow": number}}
    document["hood"] |= slips
    # G between two strands: their parts across the finger cancel. A: what its spring to the slip takes of all three.
    to_slip = side * pp / ((1 - g_long) * pp + d_long * mp)
    to_band = side * pp / ((1 - g_long) * pp + f_long * mp)
    central = to_band / (to_slip + to_band)
    square = 1.0 / (1.0 + (2.0 * side * pp / ((1 - a_long) * pp + f_long * mp)) ** 2)
    # Springs of one stiffness: the central one moves with A, the askew ones by the cosine of their angle.
    extensor = 1.0 / (1.0 + 2.0 * square)
    fractions = {f"{m}_ES": central for m in ("RI", "LU", "UI")} | {"EDC_ES": extensor, "RI_EM": 1.0, "UI_EM": 1.0}
    return finger_from_dict(document, "rhombus.yaml"), fractions
