"""Tables beside the rows of Barry et al. 2018: each muscle, the baselines and their deficits, and what was assumed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fingermodel.studies.activation import DIRECTIONS, work_out
from fingermodel.studies.activation_result import ActivationResult, angle_between
from server.reproduce.printed import reference
from server.reproduce.study import Line, Sheet

if TYPE_CHECKING:
    from fingermodel.isometric.forces import IsometricFinger

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A baseline of the study: finger, direction and size of its tip force, and what came of it."""

    finger: str
    direction: str
    size_N: float
    result: ActivationResult
    held: IsometricFinger

    @property
    def name(self) -> str:
        """Name of the baseline for readers: finger, force and direction."""
        return f"{self.finger.removeprefix('barry2018_')}, {self.size_N:.3g} N {self.direction}"


def alone(result: ActivationResult) -> Sheet:
    """Return the tension and tip force of every muscle, fully active."""
    lines = []
    for m in result.alone:
        planes = [m.as_dict()[plane] for plane in ("sagittal", "coronal")]
        turned, sizes = ([plane[key] for plane in planes] for key in ("direction_deg", "magnitude_N"))
        lines.append((m.muscle, m.tension_N, *map(float, m.per_newton), *turned, *sizes))
    return Sheet(
        f"Tip force of each muscle alone, {result.finger}",
        (
            "muscle", "tension, fully active [N]", "proximal [N/N]", "dorsal [N/N]", "radial [N/N]",
            "sagittal direction [deg]", "coronal direction [deg]", "sagittal [N]", "coronal [N]",
        ),
        lines,
        ("On the clamp, in the distal phalanx's axes; directions from proximal towards dorsal and towards radial.",),
    )  # fmt: skip


def levels(cases: Sequence[Case]) -> Sheet:
    """Tabulate the muscles behind the baselines' forces."""
    return Sheet(
        "Activities of the baselines",
        ("baseline", "muscle", "activation [%]", "tension [N]"),
        [
            (case.name, m, 100.0 * float(a), float(t))
            for case in cases
            for m, a, t in zip(case.result.muscles, case.result.activation, case.result.tension_N, strict=True)
            if a > 0.0 or t > 0.1
        ],
        [f"{c.name}: {note}" for c in cases for note in c.result.notes if "torque:" in note],
    )


def deficits(case: Case) -> Sheet:
    """Return the size and turn of one baseline's force while each muscle loses activation."""
    levels = case.result.deficits[0].levels_pct
    return Sheet(
        f"Deficits: {case.name}",
        (
            "muscle",
            *(f"{x:g} % [N]" for x in levels),
            *(f"{x:g} % turned [deg]" for x in levels[1:]),
            "0 %, change of size [%]",
        ),
        [(d.muscle, *map(float, d.magnitudes), *d.change_deg()[1:], d.change_pct[-1]) for d in case.result.deficits],
    )


def reach(cases: Sequence[Case]) -> Sheet:
    """Tabulate how far a lost muscle can turn and weaken the force, for any activities that make it."""
    palmar, dorsal, thumb_palmar, thumb_dorsal = cases
    published = (
        (palmar, "FDP", "60 deg, 1.9 N"), (dorsal, "FDI", "83 deg"), (thumb_dorsal, "EPL", "73.1 deg, 4.4 N"),
        (thumb_palmar, "FPL", "40.5 N less at 50 %"), (thumb_palmar, "ADP", "32 N less"),
    )  # fmt: skip
    lines = []
    for case, muscle, printed in published:
        start = case.size_N * np.array(DIRECTIONS[case.direction])
        ends = [_lost(case, muscle, sign) for sign in (1.0, -1.0)]
        cells = [(tension, angle_between(start, force), float(np.linalg.norm(force))) for tension, force in ends]
        lines.append((case.name, muscle, printed, *cells[0], *cells[1]))
    return Sheet(
        "Total loss of a muscle, over all activities that put the baseline's force on the clamp",
        (
            "baseline", "muscle", "published", "least tension [N]", "turned [deg]", "force left [N]",
            "most tension [N]", "turned [deg] ", "force left [N] ",
        ),
        lines,
        (
            "With or without a torque on the clamp. A force changes by what the lost tension did: the published turns "
            "need the tensions that EMG gave the paper's muscles.",
        ),
    )  # fmt: skip


def _lost(case: Case, muscle: str, sign: float) -> tuple[float, Floats]:
    """Return least (sign 1) or greatest (-1) tension that a muscle loses [N], and the force that is left (3,)."""
    from scipy.optimize import linprog

    held = case.held
    names = held.finger.topology.muscles
    placed = held.place(np.deg2rad(case.result.posture_deg))
    rest, full = np.asarray(held.hold(placed, np.stack([np.zeros(len(names)), np.ones(len(names))])).tension)
    unit = np.asarray(placed.wrench)[:3] @ np.asarray(placed.arms)
    start = case.size_N * np.array(DIRECTIONS[case.direction])
    heads: dict[str, list[str]] = held.finger.document.get("heads", {})
    chosen = np.isin(names, heads.get(muscle, [muscle]))
    bounds = list(zip(rest, np.maximum(full, rest), strict=True))
    found = linprog(np.where(chosen, sign, 0.0), A_eq=unit, b_eq=start, bounds=bounds, method="highs")
    tension = np.where(chosen, found.x - rest, 0.0)
    return float(tension.sum()), start - unit @ tension


def postures(cases: Sequence[Case]) -> Sheet:
    """Return the tip force per newton of tension where the finger is held otherwise."""
    lines: list[Line] = []
    choices: tuple[tuple[Case, dict[str, float], tuple[str, ...]], ...] = (
        (cases[0], {}, ("FDP", "FDS", "FDI")),
        (cases[0], {"MCP": 30.0, "PIP": 30.0}, ("FDP", "FDS", "FDI")),
        (cases[0], {"MCP": 60.0, "PIP": 60.0}, ("FDP", "FDS", "FDI")),
        (cases[2], {}, ("FPL", "EPL", "ADP")),
        (cases[2], {"MP": 20.0, "IP": 20.0}, ("FPL", "EPL", "ADP")),
        (cases[2], {"MP": 45.0, "IP": 45.0}, ("FPL", "EPL", "ADP")),
    )
    for case, posture, muscles in choices:
        r = work_out(case.held, posture_deg=posture)
        angles = ", ".join(f"{n} {a:g}" for n, a in zip(r.rotations, r.posture_deg, strict=True))
        for m in r.alone:
            if m.muscle in muscles:
                sagittal = m.as_dict()["sagittal"]["direction_deg"]
                lines.append((r.finger, angles, m.muscle, *map(float, m.per_newton), sagittal, r.condition))
    return Sheet(
        "Tip force per newton of tension in other postures",
        (
            "finger", "posture [deg]", "muscle", "proximal [N/N]", "dorsal [N/N]", "radial [N/N]",
            "sagittal direction [deg]", "condition",
        ),
        lines,
    )  # fmt: skip


def passive(cases: Sequence[Case]) -> Sheet:
    """Tabulate the influence of passive torques."""
    lines: list[Line] = []
    for case in (cases[0], cases[2]):
        placed = case.held.place(np.deg2rad(case.result.posture_deg))
        for name, force in zip(case.result.rotations, -10.0 * np.asarray(placed.wrench)[:3].T, strict=True):
            lines.append((case.finger, name, *map(float, force), float(np.linalg.norm(force))))
    return Sheet(
        "What a passive torque of 10 N mm against each angle adds to the tip force",
        ("finger", "angle", "proximal [N]", "dorsal [N]", "radial [N]", "size [N]"),
        lines,
    )


def arms(cases: Sequence[Case]) -> Sheet:
    """Return moment arms at 0 beside quoted ones."""
    quoted = reference("barry2018")
    lines: list[Line] = []
    for case, name in ((cases[0], "index"), (cases[2], "thumb")):
        topology = case.held.finger.topology
        ours = np.asarray(case.held.place(np.zeros(len(topology.rotations))).arms)
        for muscle, numbers in quoted[name]["muscles"].items():
            column = topology.muscles.index(muscle)
            lines += [
                (case.finger, muscle, angle, theirs, float(ours[topology.rotations.index(angle), column]))
                for angle, theirs in zip(quoted[name]["columns"], numbers, strict=True)
                if theirs is not None
            ]
    return Sheet(
        "Moment arms at 0 deg beside quoted ones, flexion positive",
        ("finger", "muscle", "angle", "quoted [mm]", "ours [mm]"),
        lines,
        (
            f"Thumb: {quoted['thumb']['source']}; index: {quoted['index']['source']}.",
            "The lines of FPB, APB, ADPo and ADPt were laid by these numbers; the others are MyoHand's.",
        ),
    )
