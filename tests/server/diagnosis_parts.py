"""Parts of a diagnosis's answer: load cases, errors, rows of the ranking, assumptions, sizes."""

from __future__ import annotations

import math
from typing import Any

Answer = dict[str, Any]


HOSTILE = "</script><script>alert('x')</script> <b>& $x_1$"
POSTURES = ("hyperextension", "minor_flexion", "hook", "major_flexion")
MASSES = {"RI": 650.0, "UI": 500.0, "LU": 45.0, "EDC": 400.0, "FDS": 950.0, "FDP": 950.0}
BOTH = {"FDP": 500.0, "FDS": 500.0}
EFFECTS = [
    "hanger_mass",
    "rig_friction",
    "worn_pulley.FDP",
    "worn_pulley.FDS",
    "worn_pulley.EDC",
    "hood_shift",
    "lumbrical_on_fdp",
    "fdp_fds_coupling",
    "sheath_friction",
    "goniometer_bias",
    "segment_length",
    "tip_location",
    "centre_migration",
    "axis_tilt",
    "lateral_band_slip",
    "intrinsic_bowstring",
    "bowstringing",
    "clamp_compliance",
    "volar_plate",
    "joint_friction",
    "suture_angle",
    "cell_rotation",
    "cell_crosstalk",
    "zero_offset.tip",
    "zero_offset.bone",
    "tare_drift",
]
CLASSES = [["rig_friction", "cell_crosstalk"], ["suture_angle", "cell_rotation"], ["tip_location", "segment_length"]]


def errors(rmse: float, cases: int = 24) -> dict[str, Any]:
    """An error summary in two planes."""
    one = {"cases": cases, "components": 2 * cases, "rmse_N": rmse, "rmse_rel_pct": 60 * rmse}
    one |= {"magnitude_error_N": 0.8 * rmse, "magnitude_error_pct": 55 * rmse, "direction_error_deg": 20 * rmse}
    return {"sagittal": one, "space": one | {"rmse_N": 0.9 * rmse, "components": 3 * cases}}


def row(effects: list[str], probability: float, gain: float, after: float | None = None, **more: Any) -> dict[str, Any]:
    """A row of the ranking."""
    out: dict[str, Any] = {"effects": effects, "probability": probability, "log_evidence_gain": gain}
    out["validation_rmse_N"] = {"before": 0.171, "after": after}
    out |= {"parameters": [], "indistinguishable_from": [], "variant": None, "in_range": True}
    out |= {"size_N": None, "size_low_N": None, "size_high_N": None, "detectability": None}
    return out | more


def value(name: str, found: float, sd: float, unit: str) -> dict[str, Any]:
    """A fitted parameter."""
    return {"name": name, "value": found, "sd": sd, "unit": unit}


def wave(*numbers: int) -> float:
    """A number between 0 and 1 that looks like chance and is always the same."""
    return math.sin(12.9898 * sum((i + 1) * n for i, n in enumerate(numbers)) + 4.1) * 0.5 + 0.5


def load_cases() -> list[dict[str, Any]]:
    """Single tendons at the tip and both flexors at tip and bone, in four postures."""
    out = []
    for p, posture in enumerate(POSTURES):
        loads = [("identification", "tip", {m: mass}) for m, mass in MASSES.items()]
        loads += [
            ("validation", where, {m: f * g for m, g in BOTH.items()}) for where in ("tip", "bone") for f in (0.6, 1.0)
        ]
        for i, (role, location, masses) in enumerate(loads):
            measured = [-0.002 * sum(masses.values()), 0.3 + 0.2 * wave(p, i), 0.05]
            off = 0.04 + 0.3 * wave(p, i, 1)
            case = {"id": f"c{10 * p + i + 1:03d}", "role": role, "posture": posture, "location": location}
            forces = {"measured_N": measured, "measured_sd_N": [0.03, 0.03, 0.02]}
            forces["before_N"] = [measured[0] + off, measured[1] - 0.5 * off, measured[2]]
            forces["after_N"] = [measured[0] + 0.2 * wave(i, p), measured[1], measured[2] + 0.02]
            out.append(case | {"masses_g": masses} | forces)
    return out


def where(cases: list[dict[str, Any]]) -> dict[str, Any]:
    """Where it fails, made up from the cases' own words."""
    cells, torques = [], []
    seen: dict[tuple[str, str, str], int] = {}
    for k, case in enumerate(cases):
        muscles = "+".join(case["masses_g"])
        key = (muscles, case["posture"], case["location"])
        seen[key] = seen.get(key, 0) + 1
        if seen[key] == 1:
            z = 0.4 + 9 * wave(k, 3) ** 3 + (6 if muscles == "LU" else 0)
            cell = {"muscles": muscles, "posture": case["posture"], "location": case["location"]}
            cells.append(cell | {"cases": 1, "rmse_N": 0.03 * z, "z_rms": z})
        if case["location"] == "tip":
            found = {j: s * (wave(k, i) - 0.4) for i, (j, s) in enumerate((("MCP", 9.0), ("PIP", 14.0), ("DIP", 3.0)))}
            one = {"id": case["id"], "posture": case["posture"], "muscles": muscles, "torque_Nmm": found}
            torques.append(one | {"sd_Nmm": {"MCP": 2.1, "PIP": 1.4, "DIP": 0.9}})

    def groups(names: tuple[str, ...] | list[str]) -> dict[str, Any]:
        return {n: {"cases": 4 + i, "rmse_N": 0.05 + 0.03 * i, "z_rms": 1.2 + i} for i, n in enumerate(names)}

    return {
        "by_muscle": groups([*MASSES, "FDP+FDS"]),
        "by_posture": groups(POSTURES),
        "by_location": groups(["tip", "bone"]),
        "by_load_level": groups(["low", "high"]),
        "by_component": groups(["Fx", "Fy", "Fz"]),
        "cells": cells,
        "joint_torque_Nmm": {
            "MCP": {"rms": 3.1, "sd": 2.1},
            "PIP": {"rms": 6.0, "sd": 1.4},
            "DIP": {"rms": 1.0, "sd": 0.9},
        },
        "joint_torque_cases": torques,
    }


def confounding() -> dict[str, Any]:
    """How alike the effects' traces are, high within the classes."""
    together = {frozenset((a, b)) for c in CLASSES for a in c for b in c}
    matrix = [
        [
            1.0 if a == b else 0.95 if frozenset((a, b)) in together else 0.85 * wave(*sorted((i, k)))
            for k, b in enumerate(EFFECTS)
        ]
        for i, a in enumerate(EFFECTS)
    ]
    grouped = {n for c in CLASSES for n in c}
    return {
        "effects": EFFECTS,
        "correlation": matrix,
        "classes": [*CLASSES, *([n] for n in EFFECTS if n not in grouped)],
    }


def assumed() -> list[dict[str, Any]]:
    """What a sensitivity analysis asks, two of the answers far from sure."""
    tried = [
        ("prior", "the prior of nothing is 0.2", 0.97),
        ("prior", "the prior of nothing is 0.8", 0.91),
        ("width", "effects may be 0.5 times as large", 0.93),
        ("budget", "the budget is 2 times as large", 0.92),
        ("budget", "the budget is 4 times as large", 0.71),
        ("noise", "the noise is 4 mN larger", 0.95),
        *(("without", f"without posture {p}", 0.94 - 0.5 * (p == "hook")) for p in POSTURES),
        ("plane", "only the sagittal plane counts", 0.96),
    ]
    return [{"group": g, "words": w, "probability": p} for g, w, p in tried]


def size_curves() -> list[dict[str, Any]]:
    """A change that grows with the load, by posture, mount and tendon."""
    out = []
    for posture in POSTURES:
        for location in ("tip", "bone"):
            for muscle, mass in MASSES.items():
                load = [0.25 * k * mass for k in range(1, 5)]
                change = [1e-4 * m * (2.0 if location == "bone" else 1.0) for m in load]
                band = {"low_N": [0.8 * c for c in change], "high_N": [1.2 * c for c in change]}
                one: dict[str, Any] = {"posture": posture, "location": location, "muscle": muscle}
                out.append(one | {"load_g": load, "change_N": change} | band)
    return out
