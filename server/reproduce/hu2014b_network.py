"""An's index finger under the elastic hood, pressed as Hu et al. 2014b pressed it: what its springs and nodes do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from daq.locations import data_dir
from fingermodel.fingers.files import finger_from_dict
from fingermodel.hood.elastic import home, pulls_of, shape_of
from fingermodel.hood.equilibrium import equilibria
from fingermodel.hood.network import displacements
from fingermodel.hood.parts import ElasticHood
from fingermodel.hood.sharing import bone_lengths, slip_excursions
from fingermodel.inverse.pressing import pressing_posture, pressing_wrench
from fingermodel.kinematics import joint_poses
from fingermodel.model import jax_values
from fingermodel.statics import joint_loads
from fingermodel.tendons import joint_pulls
from server.reproduce.hu2014a_fingers import moments
from server.reproduce.printed import reference

if TYPE_CHECKING:
    from fingermodel.fingers import Finger

Floats = NDArray[np.float64]
Change = Callable[[dict[str, Any]], None]
ROUNDED = 0.05
"""Half a digit of Table 1's muscle forces, in loads."""
BY_LAW = 0.4
"""LE over RI + LU + UI by the paper's Eq 8: LE = ES = (RI + LU + UI) / 3 + LE / 6."""


@dataclass(frozen=True)
class Held:
    """The hood in one posture under one load."""

    name: str  # of the load
    size_N: float  # of the load
    posture: Floats  # (rotations,) [rad]
    pulls_N: dict[str, float]  # of the muscles, by name
    length_mm: Floats  # (springs,) where nothing pulls
    change_mm: Floats  # (springs,) of their lengths; negative where slack
    force_N: Floats  # (springs,), 0 where slack
    change_within_mm: Floats  # (springs,) by how much half a digit of Table 1 in every muscle force moves `change_mm`
    force_within_N: Floats  # likewise
    # (nodes, 2) along (proximal of the MCP centre, on the straight finger) and around, where nothing pulls.
    home_mm: Floats
    moved_mm: Floats  # (nodes, 2) displacement under load, in the same axes
    slips_N: dict[str, float]  # tension of the finger's slips and of the muscles that pull at the hood


class Stretched(NamedTuple):
    """Excursions across the joints in the three postures, for any layout of the hood."""

    posture: Floats  # (3, rotations) [rad]
    excursion: dict[str, Floats]  # of each slip, (3,) against the straight finger [mm]


def mended(load: str, spring: str) -> tuple[float, float]:
    """Return the length change [mm] and force [N] of a spring under a load, as printed, misprints mended."""
    tables = reference("hu2014b")
    length, force = tables["components"][load][spring]
    mend = tables["misprints"].get(load, {}).get(spring, {})
    return float(mend.get("length_mm", length)), float(mend.get("force_N", force))


def printed_loads() -> list[dict[str, Any]]:
    """Return Table 1: angles, loads, muscle and contact forces, as printed."""
    loads: list[dict[str, Any]] = reference("hu2014a")["loads"]
    return loads


def index_with_network(change: Change | None = None) -> Finger:
    """Return An's index finger with the hood of the paper's 18 springs, pressed at the end of the distal phalanx.

    Args:
        change: to the hood's file before it is used, to see what an assumption does.
    """
    folder = data_dir()
    raw = {
        name: yaml.safe_load((folder / f"{name}.yaml").read_text(encoding="utf-8"))
        for name in ("fingers/an1979_index", "fingers/synek2019_network", "hoods/hu2014b_index")
    }
    finger, other, network = raw.values()
    if change is not None:
        change(network)
    block = other["hood"] | {"network": network}
    # Both interossei enter whole, as in the paper.
    finger |= {"id": "index_with_network", "hood": block, "sources": finger["sources"] | other["sources"]}
    tip = [-reference("hu2014a")["distal_phalanx_mm"], 0.0, 0.0]
    return finger_from_dict(finger, "index_with_network").replace_values(load_point=tip)


def hood_of(finger: Finger) -> ElasticHood:
    """Return the finger's elastic hood."""
    hood = finger.topology.hood
    assert isinstance(hood, ElasticHood)  # noqa: S101 - built above
    return hood


def pulls_by_table_1(load: Mapping[str, Any]) -> dict[str, float]:
    """Return muscle forces [N] as Table 1 has them, LE by the paper's own Eq 8."""
    size = float(np.linalg.norm(load["force_N"]))
    pulls = {m: size * float(load["printed"][m]) for m in ("RI", "LU", "UI")}
    return pulls | {"EDC": BY_LAW * sum(pulls.values())}


def pulls_by_components(load: Mapping[str, Any]) -> dict[str, float]:
    """Return muscle forces [N] that the printed forces of the springs at each muscle's node add up to."""
    force = {name: float(f) for name, (_, f) in reference("hu2014b")["components"][load["name"]].items()}
    return {
        "RI": force["GH"] + force["HA"],
        "LU": force["GC"] + force["FG"] + force["GB"] - force["GH"],
        "UI": force["MN"] + force["NA"],
        "EDC": force["AB"] + force["FA"] + force["LA"],
    }


@cache
def stretched() -> Stretched:
    """Return the lengthening of An's slips in the three postures."""
    import jax
    import jax.numpy as jnp

    finger = index_with_network()
    topology, values = finger.topology, jax_values(finger.values)
    postures = [pressing_posture(topology, load["theta_deg"]) for load in printed_loads()]
    slips = tuple(dict.fromkeys(s for s in hood_of(finger).slips if s))
    together = jax.jit(jax.vmap(lambda q: slip_excursions(topology, values, joint_poses(topology, values, q), slips)))
    rows = np.asarray(together(jnp.array(postures)))
    return Stretched(np.array(postures), dict(zip(slips, rows.T, strict=True)))


def held_by(finger: Finger, loads: Sequence[Mapping[str, Any]], pulls_N: Sequence[Mapping[str, float]]) -> list[Held]:
    """Settle the hood in the three postures, each under its own muscle forces, and with these rounded otherwise.

    Args:
        finger: of `index_with_network`.
        loads: of `printed_loads`.
        pulls_N: RI, LU, UI and EDC [N], for each load.
    """
    import jax
    import jax.numpy as jnp

    hood, values, across = hood_of(finger), jax_values(finger.values), stretched()
    length, fraction = bone_lengths(finger.topology, values), jnp.asarray(values.fraction)
    sizes = [float(np.linalg.norm(load["force_N"])) for load in loads]
    shapes, pulls = [], []
    for k, given in enumerate(pulls_N):
        excursion = jnp.array([across.excursion[s][k] if s else 0.0 for s in hood.slips])
        shape = shape_of(hood, length, excursion, fraction)
        for tension in (given, *_rounded_otherwise(given, ROUNDED * sizes[k])):
            shapes.append(shape)
            pulls.append(pulls_of(hood, {m: jnp.asarray(t) for m, t in tension.items()}, fraction))
    settled = equilibria(hood.network, jax.tree.map(lambda *x: jnp.stack(x), *shapes), jnp.stack(pulls))
    every = len(pulls) // len(loads)
    change, force = (np.asarray(x) for x in (settled.springs.elongation, settled.springs.tension))
    out = []
    for k, (load, given) in enumerate(zip(loads, pulls_N, strict=True)):
        at = k * every
        shape, others = shapes[at], slice(at + 1, at + every)
        slips = {m: float(t) for m, t in given.items()}
        for name, t, direction in zip(hood.slips, force[at], np.asarray(settled.springs.direction[at]), strict=True):
            if name:
                slips[name] = slips.get(name, 0.0) + float(t * direction[0])
        out.append(
            Held(
                name=str(load["name"]),
                size_N=sizes[k],
                posture=across.posture[k],
                pulls_N=dict(given),
                length_mm=np.linalg.norm(np.asarray(shape.span), axis=1) + np.asarray(shape.slack),
                change_mm=change[at],
                force_N=force[at],
                change_within_mm=_within(change[others] - change[at]),
                force_within_N=_within(force[others] - force[at]),
                home_mm=np.asarray(home(hood, length)),
                moved_mm=np.asarray(displacements(hood.network, shape, settled.ways[at])),
                slips_N=slips,
            )
        )
    return out


def _rounded_otherwise(pulls_N: Mapping[str, float], by_N: float) -> list[dict[str, float]]:
    """Return the muscle forces with one of the printed three half a digit more or less; the fourth follows by Eq 8."""
    return [
        {**pulls_N, m: pulls_N[m] + d, "EDC": pulls_N["EDC"] + BY_LAW * d}
        for m in ("RI", "LU", "UI")
        for d in (by_N, -by_N)
    ]


def _within(moved: Floats) -> Floats:
    """Return the larger of up and down for each muscle, summed over the muscles."""
    return np.asarray(np.abs(moved).reshape(-1, 2, moved.shape[1]).max(axis=1).sum(axis=0))


def contact_of(finger: Finger, loads: Sequence[Mapping[str, Any]], held: Sequence[Held]) -> list[dict[str, float]]:
    """Return forces between the bones by joint, per newton of load, with FDP as it balances the load about the DIP."""
    import jax
    import jax.numpy as jnp

    topology, values = finger.topology, jax_values(finger.values)
    terminal = hood_of(finger).terminal_slip

    @jax.jit
    def between(posture: jax.Array, tension: jax.Array, wrench: jax.Array) -> jax.Array:
        poses = joint_poses(topology, values, posture)
        return joint_loads(poses, joint_pulls(topology, values, poses), tension, wrench)

    out = []
    for load, one in zip(loads, held, strict=True):
        arms, demand, _ = moments(finger, dict(load))
        flexor = (demand["DIP"] - arms["DIP", terminal] * one.slips_N[terminal]) / arms["DIP", "FDP"]
        slips = one.slips_N | {"FDP": flexor}
        tension = jnp.array([slips.get(s.slip, 0.0) for s in topology.segments])
        wrench = jnp.asarray(pressing_wrench(load["theta_deg"], load["force_N"]))
        size = np.linalg.norm(np.asarray(between(jnp.asarray(one.posture), tension, wrench)), axis=1) / one.size_N
        out.append({joint.name: float(c) for joint, c in zip(topology.joints, size, strict=True)})
    return out
