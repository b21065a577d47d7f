"""Answers of a diagnosis with every verdict, and one with hostile names in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.server.diagnosis_parts import (
    EFFECTS,
    HOSTILE,
    Answer,
    assumed,
    confounding,
    errors,
    load_cases,
    row,
    size_curves,
    value,
    wave,
    where,
)


def found() -> Answer:
    """An answer in which the hanger was not weighed."""
    cases = load_cases()
    hanger = row(
        ["hanger_mass"],
        0.962,
        310.2,
        0.031,
        parameters=[value("hanger_mass.all", 41.3, 2.6, "g")],
        size_N=0.192,
        size_low_N=0.168,
        size_high_N=0.215,
        detectability=31.0,
    )
    rest = [
        row(
            ["hanger_mass", "goniometer_bias"],
            0.021,
            306.4,
            0.032,
            parameters=[
                value("hanger_mass.all", 40.9, 2.8, "g"),
                *(
                    value(f"goniometer_bias.{j}", 0.012 * s, 0.017, "rad")
                    for j, s in (("MCP", 1), ("PIP", -2), ("DIP", 0))
                ),
            ],
            size_N=0.2,
            size_low_N=0.17,
            size_high_N=0.23,
        ),
        row(["worn_pulley"], 0.004, 281.0, 0.088, variant="worn_pulley.FDP", indistinguishable_from=["rig_friction"]),
        row(["zero_offset"], 0.0009, 240.5, 0.12, variant="zero_offset.tip", in_range=False, size_N=0.11),
        row([], 2.3e-138, 0.0, 0.171),
        row(["none_of_catalogue"], 0.0121, 299.1, None),
        *(row([e], 1e-30 * 0.1**k, 150.0 - 9 * k, 0.16) for k, e in enumerate(EFFECTS[7:20])),
    ]
    return {
        "schema": "fingertwin/diagnose/1",
        "session": "DEV-01",
        "model": "an1979_middle",
        "verdict": "found",
        "effects": ["hanger_mass"],
        "probability": 0.962,
        "confirmed": None,
        "sentence": "Every loaded tendon carries about 41 g more than was written down: the hanger was not weighed.",
        "reasons": [
            "The residual grows with the number of loaded tendons and not with their load.",
            "The held-out error falls from 0.171 N to 0.031 N.",
            "The value, 41.3 ± 2.6 g, lies within what hangers weigh.",
        ],
        "probability_of": "hanger_mass acts by its known law, whatever else does",
        "candidates_searched": 378,
        "notes": ["The out-of-plane forces rest on the clamp carrying no Mx and My."],
        "robustness": {
            "flips_when": [],
            "rests_on": [],
            "budget_multiple_at_which_it_fails": 3.2,
            "sagittal_alone": "found",
            "assumptions": assumed(),
        },
        "suspects": [
            {
                "case": "c056",
                "probability": 0.99,
                "reads_like": [{"words": "FDS hung, not FDP", "masses_g": {"FDS": 950.0}, "posture": "hook"}],
                "verdict_without": {"verdict": "found", "effects": ["hanger_mass"], "probability": 0.96},
            }
        ],
        "session_faults": [{"kind": "side", "words": "the finger is mirrored", "probability": 0.03}],
        "repeatability": {
            "value_pct": 1.31,
            "sd_pct": 0.2,
            "stated_pct": 0.0,
            "component_pct": 0.41,
            "component_sd_pct": 0.2,
            "direction_pct": 0.52,
            "direction_sd_pct": 0.1,
            "angle_deg": 0.75,
            "angle_sd_deg": 0.3,
            "weight_pct": 0.62,
            "weight_sd_pct": 0.2,
            "line_deg": 0.65,
            "line_sd_deg": 0.2,
            "zero_mN": 12.5,
            "zero_sd_mN": 3.0,
            "drift_mN": 6.5,
            "drift_sd_mN": 2.0,
            "mounting_deg": 0.35,
            "mounting_sd_deg": 0.1,
            "hold_mm": 1.15,
            "hold_sd_mm": 0.3,
            "apart_deg": 0.85,
            "apart_sd_deg": 0.2,
        },
        "beyond": {"probability": 0.034, "amplitude_N": 0.021},
        "budget_multiple": {"value": 1.62, "sd": 0.3, "carried_by": ["zero.bone.z"]},
        "noise_multiple": {"value": 1.0, "sd": 0.0, "assumed": False},
        "extra_noise_N": {"value": 0.0041, "sd": 0.0008},
        "predictive_check": {
            "log_density_before": -210.0,
            "p_value_before": 1e-9,
            "log_density_after": 40.5,
            "p_value_after": 0.31,
            "missed_after": [],
        },
        "size": {"curves": size_curves()},
        "ranking": [hanger, *rest],
        "inclusion": {"hanger_mass": 0.983, "goniometer_bias": 0.024, "worn_pulley": 0.004},
        "where": where(cases),
        "confounding": confounding(),
        "detectability": {e: 0.6 + 30 * wave(i) ** 4 for i, e in enumerate(EFFECTS)} | {"hanger_mass": 31.0},
        "nulls": [
            {"name": "force_balance", "verdict": "violated", "text": "Tip and bone differ by 0.41 ± 0.05 N along Σtv."},
            {"name": "FDS has no DIP torque", "verdict": "holds", "text": "0.3 ± 0.9 N mm."},
            {
                "name": "superposition",
                "verdict": "violated",
                "text": "FDP and FDS together fall short of their sum by 0.12 ± 0.03 N, as if one were counted twice.",
            },
            {"name": "two_load_levels", "verdict": "not_tested", "text": "No tendon was loaded at two levels."},
        ],
        "chi_square": {"value": 812.4, "degrees_of_freedom": 120, "p_value": 0.0, "after": 131.9},
        "cases": cases,
        "before": {
            "identification/tip": errors(0.21),
            "validation/tip": errors(0.171, 8),
            "validation/bone": errors(0.33, 8),
        },
        "after": {
            "identification/tip": errors(0.034),
            "validation/tip": errors(0.031, 8),
            "validation/bone": errors(0.06, 8),
        },
        "hints": [
            {
                "stage": "tension",
                "joint": None,
                "formula": "m0*g",
                "log_evidence_gain": 301.0,
                "left_out_gain": 288.5,
                "text": "A constant tension on every loaded tendon takes up nearly all that is left.",
            },
            {
                "stage": "torque",
                "joint": "PIP",
                "formula": "k*t_EDC*sin(q_PIP)",
                "log_evidence_gain": 12.0,
                "text": "A torque at the PIP that grows with the extensor's tension and with flexion.",
            },
        ],
        "next_cases": [
            {
                "posture": "hook",
                "location": "tip",
                "masses_g": {"LU": 20.0},
                "information_nat": 0.41,
                "separates": ["hanger_mass", "worn_pulley.FDP"],
                "text": "Hang 20 g on the lumbrical in the hook posture: the two predictions differ by 0.3 N.",
            },
            {
                "posture": "major_flexion",
                "location": "bone",
                "masses_g": {"FDP": 950.0},
                "information_nat": 0.12,
                "separates": ["hanger_mass", "none_of_catalogue"],
                "text": None,
            },
        ],
        "seconds": 1.84,
    }


def one_of() -> Answer:
    out = found()
    out |= {"verdict": "one_of", "effects": ["cell_rotation", "suture_angle"], "probability": 0.94, "sentence": ""}
    out |= {"size": None, "suspects": [], "session_faults": []}
    out["ranking"] = [
        row(["cell_rotation"], 0.55, 40.1, 0.05, indistinguishable_from=["suture_angle"]),
        row(["suture_angle"], 0.39, 39.8, 0.052, indistinguishable_from=["cell_rotation"]),
        row([], 0.01, 0.0, 0.171),
        row(["none_of_catalogue"], 0.05, 37.7),
    ]
    return out


def none_of_catalogue() -> Answer:
    out = found()
    out |= {
        "verdict": "none_of_catalogue",
        "effects": [],
        "probability": 0.91,
        "sentence": "",
        "size": None,
    }
    out["ranking"] = [
        row(["none_of_catalogue"], 0.91, 55.0),
        row(["hood_shift"], 0.08, 52.5, 0.1),
        row([], 0.01, 0.0, 0.17),
    ]
    out["confounding"]["classes"] = [[e] for e in EFFECTS]
    out["curve"] = {
        "stage": "arms",
        "unit": "mm",
        "size": 1.0,
        "postures_deg": [{"PIP": 10.0, "DIP": 5.0}, {"PIP": 60.0, "DIP": 30.0}],
        "parts": [
            {"muscle": m, "joint": "PIP", "log_evidence_lost": lost, "mean": [0.1, lost], "sd": [0.2, 0.3]}
            for m, lost in (("FDS", 4.0), ("FDP", -0.2))
        ],
        "log_evidence": 12.0,
        "carried_by": [{"muscle": "FDS", "joint": "PIP", "log_evidence_lost": 4.0}],
        "sentence": "What is left is smooth over postures as an error of moment arms, most in FDS at PIP.",
    }
    return out


def nothing_missing() -> Answer:
    """A session at the tip alone, without validation cases, hints or anything to run next."""
    out = found()
    cases = [c for c in load_cases() if c["role"] == "identification" and c["posture"] == "hook"]
    out |= {
        "verdict": "nothing_missing",
        "effects": [],
        "probability": 0.97,
        "sentence": "",
        "reasons": [],
        "cases": cases,
    }
    out |= {
        "ranking": [row([], 0.97, 0.0)],
        "where": where(cases),
        "hints": [],
        "next_cases": [],
        "nulls": [],
        "notes": [],
        "size": None,
    }
    out |= {"before": {"identification/tip": errors(0.03)}, "after": {"identification/tip": errors(0.03)}}
    out["where"] |= {"joint_torque_cases": [], "joint_torque_Nmm": {}}
    out["chi_square"] |= {"value": 17.2, "degrees_of_freedom": 18, "p_value": 0.51, "after": None}
    out["confounding"] = {"effects": ["hanger_mass"], "correlation": [[1.0]], "classes": [["hanger_mass"]]}
    return out


def undecided() -> Answer:
    """Sessions pooled, and a verdict that hangs on an assumption."""
    out = found()
    del out["session"]
    out |= {
        "sessions": ["DEV-01", "DEV-02", "DEV-03", "DEV-04"],
        "verdict": "undecided",
        "effects": [],
        "probability": 0.62,
        "size": None,
    }
    out["sentence"] = "The hanger's weight is the likeliest explanation, but the verdict hangs on one posture."
    out["robustness"] = {
        "flips_when": ["the budget were twice as large", "the posture hook were left out"],
        "rests_on": ["posture hook"],
        "budget_multiple_at_which_it_fails": None,
        "sagittal_alone": "undecided",
        "assumptions": [a | {"probability": 0.6 * a["probability"]} for a in assumed()],
    }
    out["ranking"][0]["probability"] = 0.62
    out["ranking"][1]["probability"] = 0.36
    return out


HISTORY: list[dict[str, Any]] = [
    {
        "id": "r1",
        "added": [],
        "removed": [],
        "log_evidence_gain": None,
        "rmse_N": {"identification/tip": 0.21, "validation/tip": 0.171, "validation/bone": 0.33},
    },
    {
        "id": "r2",
        "added": ["worn_pulley.FDP"],
        "removed": [],
        "log_evidence_gain": 281.0,
        "rmse_N": {"identification/tip": 0.12, "validation/tip": 0.19, "validation/bone": 0.2},
    },
    {
        "id": "r3",
        "added": ["hanger_mass", "goniometer_bias"],
        "removed": ["worn_pulley.FDP"],
        "log_evidence_gain": 25.4,
        "rmse_N": {"identification/tip": 0.034, "validation/tip": 0.032, "validation/bone": 0.06},
    },
]
ANSWERS: dict[str, Callable[[], Answer]] = {
    "found": found,
    "one_of": one_of,
    "none_of_catalogue": none_of_catalogue,
    "nothing_missing": nothing_missing,
    "undecided": undecided,
}


def hostile(tree: Any) -> Any:
    """An answer whose every text is hostile, but for the words that the contract fixes."""
    if isinstance(tree, dict):
        kept = ("verdict", "role", "location", "schema", "judged_in", "group")
        return {k: v if k in kept else hostile(v) for k, v in tree.items()}
    if isinstance(tree, list):
        return [hostile(v) for v in tree]
    return f"{tree}{HOSTILE}" if isinstance(tree, str) and tree else tree
