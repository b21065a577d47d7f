"""Figures and page of a diagnosis: drawn from its answer alone, whatever the verdict and whatever is absent."""

from __future__ import annotations

import copy
import io
import json
import math
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
import pytest
from matplotlib.image import imread

from server.application.diagnosis_report import diagnosis_figures, draw_diagnosis
from server.figures.diagnosis_answer import (
    effect_name,
    explanation_name,
    named_rows,
    probability_text,
    ranked,
    with_sd,
)
from server.figures.diagnosis_confounding import confounding_figure
from server.figures.diagnosis_held_out import held_out, held_out_figure
from server.figures.diagnosis_map import residual_map
from server.figures.diagnosis_ranking import MOST_ROWS, ranking_figure
from server.figures.diagnosis_revisions import revisions_figure, steps_of
from server.figures.diagnosis_sensitivity import assumptions, sensitivity_figure
from server.figures.diagnosis_size import curves, size_figure
from server.figures.diagnosis_tables import bent_table
from server.figures.diagnosis_torque import torque_figure
from server.figures.report_front import to_do
from server.figures.static import render
from server.figures.style import NothingToDrawError

Answer = dict[str, Any]

NAMES = {
    "sensitivity", "residual_map", "missing_torque", "ranking", "size", "confounding", "revisions", "held_out",
    "own_curve",
}  # fmt: skip
HEADINGS = (
    "Verdict",
    "What to do",
    "Error before and after",
    "Suspect load cases and the rig",
    "Sensitivity analysis",
    "Where the model fails",
    "Which explanation",
    "What cannot be told apart",
    "Tests that need no model",
    "The fall of the error",
    "Hints at a formula",
    "Load cases to run next",
    "How this was found",
    "Glossary",
)
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
        ("noise", "the noise is 2 times as stated", 0.95),
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
        "repeatability": {"value_pct": 1.31, "sd_pct": 0.2, "stated_pct": 0.0},
        "beyond": {"probability": 0.034, "amplitude_N": 0.021},
        "budget_multiple": {"value": 1.62, "sd": 0.3, "carried_by": ["zero.bone.z"]},
        "noise_multiple": {"value": 1.0, "sd": 0.0, "assumed": False},
        "predictive_check": {
            "log_density_before": -210.0,
            "p_value_before": 1e-9,
            "log_density_after": 40.5,
            "p_value_after": 0.31,
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

MISSING = {
    "found": {"own_curve"},
    "one_of": {"size", "own_curve"},
    "none_of_catalogue": {"size"},
    "nothing_missing": {"missing_torque", "confounding", "held_out", "size", "own_curve"},
    "undecided": {"size", "own_curve"},
}


class Page(HTMLParser):
    """Collects a page's headings, paragraphs, addresses, scripts and words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.headings: list[str] = []
        self.paragraphs: list[str] = []
        self.addresses: list[str] = []
        self.words: list[str] = []
        self.scripts = 0
        self._into: list[str] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [str(v) for k, v in attrs if k in ("src", "href", "data", "action", "srcset")]
        self.scripts += tag == "script"
        self._into = {"h2": self.headings, "p": self.paragraphs}.get(tag)
        if self._into is not None:
            self._into.append("")

    def handle_endtag(self, tag: str) -> None:
        self._into = None

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if self._into is not None:
            self._into[-1] += data


def page(answer: Answer, folder: Path, history: list[dict[str, Any]] | None = None) -> Page:
    """Draw the page alone and read it."""
    return Page(draw_diagnosis(answer, folder, history, static=False).read_text(encoding="utf-8"))


def bars(figure: go.Figure) -> list[Any]:
    return [t for t in figure.data if t.type == "bar"]


# --- the page


@pytest.mark.parametrize("verdict", list(ANSWERS))
def test_every_verdict_gives_every_figure_that_it_can(verdict: str) -> None:
    figures = diagnosis_figures(ANSWERS[verdict]())
    assert set(figures) == NAMES - MISSING.get(verdict, set())
    for figure in figures.values():
        text = figure.to_json()
        assert "bdata" not in text, "numbers stay readable"
        assert json.loads(go.Figure(json.loads(text)).to_json()) == json.loads(text)
        assert len(render(json.loads(text), "svg")) > 1000


def test_page_and_pictures_are_written(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    written = draw_diagnosis(one_of(), folder)
    assert written == folder / "diagnose.html"
    assert {p.name for p in folder.iterdir()} == {"diagnose.html"} | {
        f"{n}.{e}" for n in NAMES - MISSING["one_of"] for e in ("png", "svg")
    }
    for name, figure in diagnosis_figures(one_of()).items():
        picture = imread(io.BytesIO((folder / f"{name}.png").read_bytes()), format="png")
        assert picture.shape[:2] == (2 * figure.layout.height, 2 * figure.layout.width)


def test_a_saved_answer_gives_the_same_page(tmp_path: Path) -> None:
    first = draw_diagnosis(found(), tmp_path / "a", static=False).read_bytes()
    saved = json.loads(json.dumps(found()))
    assert draw_diagnosis(saved, tmp_path / "b", static=False).read_bytes() == first
    assert saved == found(), "the answer is left as it was"


def test_the_verdict_comes_first_and_the_sections_in_order(tmp_path: Path) -> None:
    read = page(found(), tmp_path, HISTORY)
    assert read.headings == list(HEADINGS)
    assert read.paragraphs[:2] == ["Model: an1979_middle", found()["sentence"]]
    assert read.paragraphs[2].startswith("Verdict: found, probability 0.96. Not confirmed yet")
    assert read.paragraphs[3] == "Probability of what: hanger_mass acts by its known law, whatever else does."
    assert read.paragraphs[4] == "Suspect load case: c056 (probability 0.99)."
    assert read.paragraphs[5:8] == found()["reasons"]
    words = " ".join(read.words)
    for said in (
        "812.4 at 120 degrees of freedom (p < 0.001); 131.9 with the best explanation",
        "378 explanations searched, fitted or by the linearised model.",
        "FDS hung, not FDP",
        "The whole session: the finger is mirrored (probability 0.03",
        "bent most: zero.bone.z",
        "Of 7 other assumptions, 6 leave the verdict sure",
        "Under none of them is it less probable than not.",
        "It is no longer sure once the rig's own errors (the budget) are 3.2 times as large.",
        "acts, alone or beside others: probability 0.03; if so, about 0.02 N.",
        "Predictive check on the validation cases: p < 0.001 without any effect, p = 0.31 with",
        "Their log density changes by +250.5.",
        "40 load cases, 32 at the tip and 8 at the bone; 16 for validation.",
        "Clearly missing at PIP.",
        "not to be told apart by these load cases: suture angle and cell rotation.",
        "k*t_EDC*sin(q_PIP)",
        "Hang 20 g on the lumbrical",
        "hanger mass / worn pulley FDP",
        "0.210 → 0.034",
        "The diagnosis took 1.8 s.",
    ):
        assert said in words


@pytest.mark.parametrize(
    ("verdict", "sentence"),
    [
        ("one_of", "One of these is missing, and these load cases cannot say which: cell rotation or suture angle."),
        ("none_of_catalogue", "Something is missing that no effect of the catalogue explains."),
        ("nothing_missing", "Nothing is missing: the model explains the readings within their uncertainty."),
    ],
)
def test_a_verdict_without_a_sentence_gets_one(verdict: str, sentence: str, tmp_path: Path) -> None:
    assert page(ANSWERS[verdict](), tmp_path).paragraphs[1] == sentence


def test_what_is_absent_is_said_to_be(tmp_path: Path) -> None:
    words = " ".join(page(nothing_missing(), tmp_path).words)
    assert "No figure: no missing joint torque could be worked out." in words
    assert "No figure: there is no validation case with a prediction before and after." in words
    assert "None: no simple formula takes up what is left." in words
    assert "None: the session's load cases allow no such test." in words
    pooled = page(undecided(), tmp_path)
    assert "Diagnosis of DEV-01, DEV-02, DEV-03 and 1 more" in pooled.words
    assert (
        "It would be less probable than not if the budget were twice as large; or if the posture hook were left out."
        in pooled.paragraphs
    )
    assert "Not worked out for this answer." in page({}, tmp_path).paragraphs


def bent(name: str, widths: float) -> Answer:
    return {"name": name, "value": 0.02 * widths, "unit": "N", "stated_sd": 0.02, "widths": widths}


def test_what_to_do_follows_from_the_verdict_the_suspects_and_the_rig() -> None:
    steps = to_do(found() | {"session": "S1"})
    assert steps[0].startswith("Look at load case c056: it reads like this: FDS hung, not FDP.")
    assert steps[1].startswith("Weigh the hangers (the readings say hanger_mass.all = 41.3 ± 2.6 g)")
    assert steps[2] == "Put it into the model: fingertwin add hanger_mass S1."
    assert "to confirm it" in steps[3]
    sound = nothing_missing() | {"suspects": [], "session_faults": []}
    assert to_do(sound) == ["Nothing: no measurement and no change of the model is asked for."]
    far = {
        "where_after": {
            "added": [],
            "bent": [bent("zero.bone.z", 19.4), bent("zero.bone.x", -4.2), bent("zero.tip.x", 2.1)],
        }
    }
    assert to_do(sound | far) == [
        "Tare the bone mount again: the refit takes zero.bone.z to be 19 stated standard deviations off."
    ]


def test_errors_of_the_rig_stand_after_both_fits_where_the_model_fails() -> None:
    whole = {
        "where": {"added": [], "bent": [bent("zero.bone.z", 19.4), bent("zero.tip.x", -2.6)]},
        "where_after": {"added": ["hanger_mass"], "bent": [bent("zero.bone.z", 3.1)]},
    }
    (table,) = bent_table(whole)
    assert list(table.header)[2:4] == ["after a refit with nothing added", "after a refit with hanger mass added"]
    assert [list(row)[2:4] for row in table.rows] == [
        ["0.388 N (19 sd)", "0.062 N (3 sd)"], ["\N{MINUS SIGN}0.052 N (3 sd)", "within 2 sd"],
    ]  # fmt: skip
    assert bent_table({}) == []


def test_residuals_say_after_which_fit_they_are() -> None:
    cell = {"muscles": "FDP", "posture": "hook", "location": "tip", "cases": 1, "rmse_N": 0.1, "z_rms": 3.0}
    for added, said in (([], "nothing added"), (["hanger_mass"], "hanger mass added")):
        part = {"where": {"added": added, "cells": [cell], "joint_torque_Nmm": {"PIP": {"rms": 2.0, "sd": 0.5}}}}
        assert residual_map(part).layout.title.text == f"Where the model fails, after a refit with {said}"
        assert torque_figure(part).layout.title.text == f"Joint torque that is missing, after a refit with {said}"


@pytest.mark.parametrize("confirmed", [True, False, "revision r4"])
def test_confirmation_is_told(confirmed: object, tmp_path: Path) -> None:
    status = page(found() | {"confirmed": confirmed}, tmp_path).paragraphs[2]
    assert ("agreed" in status) is (confirmed is not False)
    assert ("revision r4" in status) is (confirmed == "revision r4")


def test_an_empty_answer_still_gives_a_page(tmp_path: Path) -> None:
    assert page({}, tmp_path).headings == list(HEADINGS)
    assert diagnosis_figures({}) == {}
    draw_diagnosis({}, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["diagnose.html"]


def holes(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of everything in an answer, of lists only the first entry."""
    out = [path] if path else []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree[:1]) if isinstance(tree, list) else ()
    for key, below in items:
        out += holes(below, (*path, key))
    return out


def test_no_absent_value_breaks_the_page() -> None:
    whole = nothing_missing() | {k: found()[k] for k in ("ranking", "hints", "next_cases", "nulls")}
    whole["size"] = {"curves": size_curves()[:2]}
    whole["where"] = where(load_cases()[6:8])
    whole["cases"] = load_cases()[6:8]
    names = EFFECTS[:3]
    whole["confounding"] = {"effects": names, "correlation": [[1.0, 0.95, 0.1]] * 3, "classes": [names[:2]]}
    whole["detectability"] = {names[0]: 3.0}
    whole["curve"] = none_of_catalogue()["curve"]
    assert set(diagnosis_figures(whole, HISTORY)) == NAMES
    whole["where"] |= {key: {} for key in ("by_posture", "by_location", "by_load_level", "by_component")}
    whole |= {when: {"validation/tip": {"space": {"rmse_N": 0.1}}} for when in ("before", "after")}
    nothings: list[Any] = [None, float("nan"), []]
    for count, path in enumerate(holes(whole)):
        broken = copy.deepcopy(whole)
        at: Any = broken
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = nothings[count % 3]
        for figure in diagnosis_figures(broken).values():
            assert "NaN" not in str(figure.to_dict())


def hostile(tree: Any) -> Any:
    """An answer whose every text is hostile, but for the words that the contract fixes."""
    if isinstance(tree, dict):
        kept = ("verdict", "role", "location", "schema", "judged_in", "group")
        return {k: v if k in kept else hostile(v) for k, v in tree.items()}
    if isinstance(tree, list):
        return [hostile(v) for v in tree]
    return f"{tree}{HOSTILE}" if isinstance(tree, str) and tree else tree


def test_hostile_names_are_shown_and_do_nothing(tmp_path: Path) -> None:
    answer = hostile(found())
    path = draw_diagnosis(answer, tmp_path, hostile(HISTORY), static=False)
    text = path.read_text(encoding="utf-8")
    read = Page(text)
    assert read.scripts == 2, "Plotly and the figures; a hostile name adds none"
    assert all(address.startswith("#") for address in read.addresses)
    assert HOSTILE not in text
    assert any(HOSTILE in word for word in read.words), "the name is still to be read"
    assert "default-src 'none'" in text
    figures = diagnosis_figures(answer, hostile(HISTORY))
    assert set(figures) == NAMES - MISSING["found"]
    for figure in figures.values():
        assert b"<script" not in render(figure, "svg")


def test_importing_the_report_loads_no_drawing_library() -> None:
    code = (
        "import sys, server.application.diagnosis_report; "
        "print([m for m in ('plotly', 'matplotlib', 'jax') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert out.stdout.strip() == "[]"


# --- where the model fails


def test_the_map_holds_every_tested_cell_and_no_other() -> None:
    figure = residual_map(found())
    tip, bone = figure.data
    cells = found()["where"]["cells"]
    assert sum(v is not None for panel in (tip, bone) for line in panel.z for v in line) == len(cells)
    assert list(figure.layout.yaxis.ticktext) == ["FDP", "FDS", "EDC", "RI", "UI", "LU", "FDP+FDS"]
    assert figure.layout.xaxis.ticktext == figure.layout.xaxis2.ticktext
    one = next(c for c in cells if (c["muscles"], c["posture"], c["location"]) == ("LU", "hook", "tip"))
    assert tip.text[5][2] == f"{one['z_rms']:.1f}"
    assert tip.z[5][2] == pytest.approx(math.log10(one["z_rms"]))
    assert [[v for v in line if v is not None] for line in bone.z][:6] == [[]] * 6
    assert [n.text for n in figure.layout.annotations] == ["<b>Cell at the tip</b>", "<b>Cell at the bone</b>"]


def test_cells_that_come_twice_are_pooled_and_colours_end_at_twenty() -> None:
    cell = {"muscles": ["FDP", "LU"], "posture": "hook", "location": "tip", "cases": 1, "rmse_N": 0.1, "z_rms": 3.0}
    figure = residual_map({"where": {"cells": [cell, cell | {"cases": 3, "z_rms": 5.0}]}})
    assert figure.data[0].text[0][0] == f"{math.sqrt((9 + 3 * 25) / 4):.1f}"
    assert list(figure.layout.yaxis.ticktext) == ["FDP+LU"]
    figure = residual_map({"where": {"cells": [cell | {"z_rms": 1e4}, cell | {"posture": "b", "z_rms": 0.01}]}})
    assert figure.data[0].z[0] == pytest.approx((math.log10(20), math.log10(0.5)))
    assert figure.data[0].text[0][0] == "10000"


def test_torque_of_alike_cases_is_their_mean() -> None:
    one = {"id": "a", "posture": "hook", "muscles": "FDP", "torque_Nmm": {"PIP": 4.0, "MCP": 0.5}}
    cases = [one | {"sd_Nmm": {"PIP": 0.6, "MCP": 1.0}}]
    cases += [one | {"id": "b", "torque_Nmm": {"PIP": 2.0}, "sd_Nmm": {"PIP": 0.8}}]
    figure = torque_figure({"where": {"joint_torque_cases": cases}})
    by_joint = {t.xaxis: t for t in bars(figure)}
    assert by_joint["x"].x == (0.5,)
    assert by_joint["x2"].x == (3.0,)
    assert by_joint["x2"].error_x.array == pytest.approx((0.5,))
    assert by_joint["x2"].name == "beyond two standard deviations"
    assert by_joint["x"].name == "within them"


def test_many_groups_leave_the_clearest_and_no_cases_the_joints() -> None:
    case = {"muscles": "FDP", "sd_Nmm": {"PIP": 1.0}}
    cases = [case | {"id": str(k), "posture": f"p{k}", "torque_Nmm": {"PIP": 0.1 * k}} for k in range(60)]
    figure = torque_figure({"where": {"joint_torque_cases": cases}})
    assert sum(len(t.x) for t in bars(figure)) == 40
    assert min(v for t in bars(figure) for v in t.x) == pytest.approx(2.0)
    assert "40 clearest of 60" in figure.layout.title.subtitle.text
    answer = found()
    answer["where"]["joint_torque_cases"] = []
    figure = torque_figure(answer)
    assert [t.x[0] for t in bars(figure)] == [3.1, 6.0, 1.0]
    assert "root mean square" in figure.layout.yaxis.ticktext[0]


# --- which explanation


def test_the_ranking_shows_nothing_and_something_else_however_improbable() -> None:
    answer = found()
    figure = ranking_figure(answer)
    kinds = {t.name: t for t in bars(figure)}
    assert len({t.marker.color for t in figure.data if t.type == "scatter"}) == len(kinds) == 3
    places = [p for t in bars(figure) for p in t.y]
    assert sorted(places) == list(range(MOST_ROWS + 1))
    assert kinds["nothing missing"].y == (MOST_ROWS,)
    assert kinds["nothing missing"].text == ("&lt;0.001",)
    assert "6 more" in figure.layout.title.subtitle.text
    words = [n.text for n in figure.layout.annotations]
    assert "<b>hanger mass</b>" in words
    assert "0.171 → 0.031" in words
    assert "0.19 (0.17–0.21)" in words
    assert "zero offset tip *" in words
    assert len(figure.layout.shapes) == 1


def test_explanations_that_were_not_weighed_are_not_drawn() -> None:
    answer = one_of()
    answer["ranking"] += [row(["axis_tilt"], 0.0, 99.0, None)]
    assert "axis tilt" not in [n.text for n in ranking_figure(answer).layout.annotations]
    answer |= {"verdict": "found", "effects": ["axis_tilt"]}
    assert "<b>axis tilt</b>" in [n.text for n in ranking_figure(answer).layout.annotations]


def test_rows_that_the_verdict_names_are_found() -> None:
    def named(answer: Answer) -> list[str]:
        return [explanation_name(r) for r in named_rows(answer)]

    assert named(found()) == ["hanger mass"]
    assert named(one_of()) == ["cell rotation", "suture angle"]
    assert named(none_of_catalogue()) == ["something else"]
    assert named(nothing_missing()) == ["nothing missing"]
    assert named(undecided()) == []
    pulley = {"effects": ["worn_pulley"], "candidates": ["worn_pulley.FDP"], "probability": 0.4}
    other = {"effects": ["worn_pulley"], "candidates": ["worn_pulley.EDC"], "probability": 0.6}
    ranking = {"ranking": [pulley, other], "effects": ["worn_pulley"], "verdict": "found"}
    assert named(ranking | {"candidates": ["worn_pulley.FDP"]}) == ["worn pulley FDP"]
    both = ranking | {"candidates": ["worn_pulley.EDC", "worn_pulley.FDP"], "verdict": "one_of"}
    assert named(both) == ["worn pulley EDC", "worn pulley FDP"]
    assert [r["probability"] for r in ranked(one_of())] == [0.55, 0.39, 0.05, 0.01]


def test_names_are_written_for_reading() -> None:
    assert [effect_name(n) for n in ("fdp_fds_coupling", "lumbrical_on_fdp", "zero_offset.bone.x")] == [
        "FDP–FDS coupling",
        "lumbrical on FDP",
        "zero offset bone x",
    ]
    both = {"effects": ["hanger_mass", "worn_pulley"], "variant": "worn_pulley.EDC"}
    assert explanation_name(both) == "hanger mass + worn pulley EDC"
    assert explanation_name(both | {"variant": ["hanger_mass", "worn_pulley.EDC"]}) == "hanger mass + worn pulley EDC"
    assert explanation_name({"effects": ["zero_offset"], "variant": "bone"}) == "zero offset (bone)"
    assert [probability_text(p) for p in (0.5, 0.004, 1e-9, 0.0, 0.995, 1.0, None)] == [
        "0.50",
        "0.004",
        "<0.001",
        "<0.001",
        "0.995",
        ">0.999",
        "–",
    ]
    assert [with_sd(*v) for v in ((41.26, 2.63), (-0.01234, 0.0011), (1e-12, 1e-13), (250.0, 120.0), (3.0, None))] == [
        ("41.3", "2.6"),
        ("−0.0123", "0.0011"),
        ("1e-12", "1e-13"),
        ("250", "120"),
        ("3", "–"),
    ]


def test_classes_stand_together_and_are_outlined() -> None:
    figure = confounding_figure(found())
    order = [t.split(", d")[0] for t in figure.layout.yaxis.ticktext]
    assert order[:2] == ["rig friction", "cell crosstalk"]
    assert len(order) == len(EFFECTS)
    assert "hanger mass, d = 31.0" in figure.layout.yaxis.ticktext
    assert [(s.x0, s.x1) for s in figure.layout.shapes] == [(-0.5, 1.5), (1.5, 3.5), (3.5, 5.5)]
    heat = figure.data[0]
    for shape in figure.layout.shapes:
        inside = range(math.ceil(shape.x0), math.ceil(shape.x1))
        assert all(heat.z[a][b] >= 0.9 for a in inside for b in inside)
    assert [heat.z[i][i] for i in range(len(order))] == [1.0] * len(order)


def test_many_effects_leave_classes_and_the_most_detectable() -> None:
    names = [f"e{i}" for i in range(50)]
    answer = {
        "confounding": {"effects": names, "correlation": [[0.1] * 50] * 50, "classes": [["e0", "e1"]]},
        "detectability": {n: float(i) for i, n in enumerate(names)},
    }
    figure = confounding_figure(answer)
    labels = [t.split(",")[0] for t in figure.layout.yaxis.ticktext]
    assert labels[:2] == ["e0", "e1"]
    assert set(labels[2:]) == set(names[20:])
    assert "32 of 50 effects" in figure.layout.title.subtitle.text


# --- before and after


def test_steps_come_from_the_history_or_from_before_and_after() -> None:
    assert [s.lines for s in steps_of(found(), HISTORY)] == [
        ["start"],
        ["+ worn pulley FDP", "log evidence +281.0"],
        ["+ hanger mass", "+ goniometer bias", "− worn pulley FDP", "log evidence +25.4"],
    ]
    before, after = steps_of(found(), None)
    assert before.rmse_N["validation/tip"] == pytest.approx(0.9 * 0.171)
    assert after.lines == ["after", "with hanger mass"]
    assert steps_of(found() | {"judged_in": "sagittal"}, None)[0].rmse_N["validation/tip"] == pytest.approx(0.171)
    assert steps_of(one_of(), None)[1].lines == ["after", "with cell rotation or suture angle"]
    assert steps_of(found(), []) == steps_of(found(), None)


def test_bars_end_at_the_error_and_caps_at_the_step_before() -> None:
    figure = revisions_figure(found(), HISTORY)
    tip = [t for t in bars(figure) if t.yaxis == "y" and t.offsetgroup == "validation"]
    solid, falls, rises, words = tip
    assert words.base == pytest.approx((0.171, 0.19, 0.032))
    assert words.text == ("0.171", "0.190", "0.032")
    assert solid.y == pytest.approx((0.171, 0.171, 0.032))
    assert falls.y == pytest.approx((0.0, 0.0, 0.158))
    assert rises.y == pytest.approx((0.0, 0.019, 0.0))
    assert rises.base[1] + rises.y[1] == pytest.approx(0.19)
    assert "+0.019" in solid.hovertext[1]


def test_a_long_history_keeps_its_first_and_last_steps() -> None:
    history = [HISTORY[0] | {"id": f"r{k}", "added": [f"e{k}"]} for k in range(30)]
    figure = revisions_figure(found(), history)
    assert [t.split("<br>")[0] for t in figure.layout.xaxis2.ticktext] == ["+ e0", *(f"+ e{k}" for k in range(23, 30))]
    assert "of 30 steps" in figure.layout.title.subtitle.text


def test_held_out_cases_are_sorted_and_measured_in_the_plane() -> None:
    cases = held_out(found())
    assert len(cases) == 16
    assert [c.before_N for c in cases] == sorted((c.before_N for c in cases), reverse=True)
    one = next(c for c in found()["cases"] if c["id"] == cases[0].label.split()[0])
    assert cases[0].before_N == pytest.approx(math.dist(one["measured_N"], one["before_N"]))
    assert cases[0].sd_N == pytest.approx(math.sqrt(0.03**2 + 0.03**2 + 0.02**2))
    flat = {c.label: c for c in held_out(found() | {"judged_in": "sagittal"})}
    assert flat[cases[0].label].after_N == pytest.approx(math.dist(one["measured_N"][:2], one["after_N"][:2]))
    figure = held_out_figure(found())
    before, after = (next(t for t in figure.data if t.name == n) for n in ("before", "after"))
    assert (list(before.x), list(after.x)) == ([c.before_N for c in cases], [c.after_N for c in cases])
    falls = sum(c.after_N < c.before_N for c in cases)
    assert f"falls in {falls} of them" in figure.layout.title.subtitle.text


# --- sensitivity and size


def test_every_assumption_has_a_dot_beside_the_line_of_the_sure() -> None:
    figure = sensitivity_figure(found())
    dots = {t.name: t for t in figure.data}
    assert {name: len(t.x) for name, t in dots.items()} == {"sure": 9, "not sure": 1, "below one half": 1}
    assert dots["not sure"].x == (0.71,)
    words = dict(zip(figure.layout.yaxis.tickvals, figure.layout.yaxis.ticktext, strict=True))
    assert words[dots["below one half"].y[0]] == "without posture hook"
    assert [s.x0 for s in figure.layout.shapes] == [0.9, 0.962]
    headings = [n.text for n in figure.layout.annotations if n.text.startswith("<b>")]
    assert headings[0] == "<b>Prior probability of nothing</b>"
    assert len(headings) == len({a["group"] for a in assumed()})


def test_of_many_parts_of_the_data_those_that_matter_most_are_drawn() -> None:
    parts = [{"group": "without", "words": f"without p{k}", "probability": 0.01 * k} for k in range(60)]
    answer = {
        "robustness": {"assumptions": [*parts, assumed()[0], {"group": "own", "words": "else", "probability": 2}]}
    }
    assert [a.probability for a in assumptions(answer)][-1] == 1.0
    figure = sensitivity_figure(answer)
    assert sum(len(t.x) for t in figure.data) == 40
    assert max(x for t in figure.data for x in t.x[:-2] if t.name == "below one half") < 0.4
    assert "22 parts" in figure.layout.title.subtitle.text


def test_size_has_a_panel_for_each_posture_and_mount_and_a_line_for_each_tendon() -> None:
    figure = size_figure(found())
    assert "hanger mass" in figure.layout.title.text
    titles = [n.text for n in figure.layout.annotations]
    assert titles[0] == "<b>Hyperextension, at the tip</b>"
    assert len(titles) == 8
    lines = [t for t in figure.data if t.mode == "lines+markers"]
    bands = [t for t in figure.data if t.fill == "toself"]
    assert len(lines) == len(bands) == 8 * len(MASSES)
    assert [t.name for t in lines if t.showlegend] == ["FDP", "FDS", "EDC", "RI", "UI", "LU"]
    assert {tuple(figure.layout[a].range) for a in ("yaxis", "yaxis8")} == {tuple(figure.layout.yaxis.range)}
    one = next(c for c in curves(found()) if c.muscle == "FDP")
    assert max(one.change_N) < figure.layout.yaxis.range[1]
    assert "950 g changes it by 0.095 N (0.076–0.114)" in lines[0].hovertext[-1]
    bare = {
        "size": {"curves": [{"muscle": "LU", "load_g": [20.0], "change_N": [0.1], "low_N": None}, {"load_g": [1.0]}]}
    }
    assert [t.mode for t in size_figure(bare).data] == ["lines+markers"]


@pytest.mark.parametrize(
    "draw",
    [
        sensitivity_figure,
        residual_map,
        torque_figure,
        ranking_figure,
        size_figure,
        confounding_figure,
        revisions_figure,
        held_out_figure,
    ],
)
def test_nothing_to_draw_is_said(draw: Callable[[Answer], go.Figure]) -> None:
    with pytest.raises(NothingToDrawError):
        draw({})
