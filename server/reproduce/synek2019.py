"""Synek et al. 2019 (PeerJ 7:e7470): every published figure beside ours, then our own fit beside their model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from daq.sessions import read_session
from daq.signals.corrections import measure
from daq.signals.friction import friction
from fingermodel import api, comparing
from fingermodel.comparison.comparison import Comparison, compare
from fingermodel.comparison.superposition import superposition
from fingermodel.scaling import mean_moment_arms
from fingermodel.session import Session
from fingermodel.studies.published import Row
from server.figures.compared import Compared
from server.figures.comparison import comparison_plans
from server.figures.plot import Plot
from server.figures.specimen_spread import spread_of
from server.reproduce.printed import reference, rows_beside
from server.reproduce.study import Line, Progress, Reproduction, Sheet
from server.reproduce.synek2019_species import GIVEN, NO_POINTS

SPECIMENS = ("HMEAN", "H01", "H02", "H03")
Numbers = dict[str, float | None]
PREDICTORS = {
    "published_model": "published optimised model",
    "published_method": "published method, this specimen",
    "ours": "our fit (map)",
    "superposition": "superposition limit",
}


@dataclass(frozen=True)
class SpecimenFit:
    """Unseen combined loads of one specimen under four predictors."""

    specimen: str  # name
    comparisons: dict[str, Comparison]  # published model as recomputed, published method, our fit, superposition limit

    def as_dict(self) -> dict[str, Any]:
        """Return errors in the sagittal plane (as published), in space, and what our fit was held to."""
        out: dict[str, Any] = {"specimen": self.specimen}
        for name, comparison in self.comparisons.items():
            out[name] = {
                key: comparison.select(*key.split("/")).both()
                for key in ("identification/tip", "validation/tip", "validation/bone")
                if comparison.select(*key.split("/")).cases
            }
        return out | {"held_to": self.held_to()}

    def held_to(self) -> dict[str, bool]:
        """Return whether our fit does what it should on loads that were never fitted.

        The tip is judged by the RMSE of its vector (direction and magnitude in one); direction and magnitude apart must
        not be worse than the published model's, unless they are already below the superposition limit, under which
        differences are luck.
        """
        ours, theirs = self._errors("ours", "tip"), self._errors("published_model", "tip")
        limit = self._errors("superposition", "tip")
        bone, their_bone = self._errors("ours", "bone"), self._errors("published_model", "bone")
        return {
            "tip_rmse": ours[0] <= theirs[0],
            "tip_direction": ours[1] <= max(theirs[1], limit[1]),
            "tip_magnitude": ours[2] <= max(theirs[2], limit[2]),
            "bone_direction_within_1_deg": bone[1] <= their_bone[1] + 1.0,
            "bone_magnitude_within_1p5_points": bone[2] <= their_bone[2] + 1.5,
        }

    def _errors(self, name: str, location: str) -> tuple[float, float, float]:
        e = self.comparisons[name].select("validation", location).errors("sagittal")
        return e.rmse_N or 0.0, e.direction_error_deg or 0.0, e.magnitude_error_pct or 0.0


def reproduce(progress: Progress) -> Reproduction:
    """Recompute the study, and fit each specimen our way."""
    rows = published_rows()
    progress(0.4)
    fits = []
    for i, name in enumerate(SPECIMENS):
        fits.append(_fit(f"synek2019_{name}", name))
        progress(0.4 + 0.6 * (i + 1) / len(SPECIMENS))
    return Reproduction(
        rows=tuple(rows),
        sheets=(_unseen(fits),),
        results={"fits": [fit.as_dict() for fit in fits]},
        plots=_plots,
    )


def published_rows() -> list[Row]:
    """Set every published figure beside ours."""
    mean = Session.open("synek2019_HMEAN", catalogue=False)
    optimised = Session.open("synek2019_HMEAN", "synek2019_optimised", catalogue=False)
    bonobo = Session.open("synek2019_B01", catalogue=False)
    numbers, human, other = reference("synek2019"), _human(mean, optimised), _bonobo(bonobo)
    return [
        *rows_beside(numbers["human"], human),
        *rows_beside(numbers["bonobo"], other, NO_POINTS),
        *rows_beside(numbers["bonobo_given"], other, GIVEN),
    ]


def _human(mean: Session, optimised: Session) -> Numbers:
    """Return our numbers of the mean human finger, by their names in the list of printed ones."""
    balance = friction([measure(read_session(f"synek2019_{s}")) for s in ("H01", "H02", "H03", "B01")])
    best = comparing.compare(optimised)
    fits = {"initial": comparing.compare(mean), "optimised": best, "refitted": _after(mean, "slsqp")}
    out: Numbers = {"c": balance.factor, "c_cases": balance.n}
    for name, comparison in fits.items():
        out |= _errors(name, comparison.select("identification", "tip"))
    for muscle in ("FDP", "FDS", "LU"):
        out |= _errors(muscle, best.select("identification", "tip", muscle))
    for location in ("tip", "bone"):
        out |= _errors(location, best.select("validation", location))
    return out | _shifts(mean, optimised) | _sizes(optimised) | _ratios(optimised)


def _bonobo(bench: Session) -> Numbers:
    """Return our numbers of the bonobo."""
    before, after = comparing.compare(bench), _after(bench, "map")
    out = _errors("initial", before.select("identification")) | _errors("optimised", after.select("identification"))
    for location in ("tip", "bone"):
        out |= _errors(location, after.select("validation", location))
    return out | _sizes(bench) | _ratios(bench)


def _errors(name: str, comparison: Comparison) -> Numbers:
    errors = comparison.errors("sagittal")
    keys = ("rmse_N", "rmse_rel_pct", "direction_error_deg", "magnitude_error_N", "magnitude_error_pct")
    return {f"{name}.{key}": getattr(errors, key) for key in keys}


def _shifts(mean: Session, optimised: Session) -> Numbers:
    """Return the mean distances that the published optimisation moved the via points by, along x and y [mm]."""
    shift: dict[tuple[str, ...], float] = {}
    ends = zip(mean.model.parameters.names, mean.model.initial, optimised.model.initial, strict=True)
    for name, before, after in ends:
        parts = name.split(".")
        if parts[0] == "point" and parts[4] != "z":
            shift[tuple(parts)] = abs(float(after - before))

    def average(*words: str) -> float:
        return float(np.mean([x for key, x in shift.items() if all(word in key for word in words)]))

    named = {".".join(words): average(*words) for words in (("x",), ("y",), ("MCP",), ("DIP",), ("MCP", "RI"))}
    out: Numbers = {"shift": average(), "shift.largest": max(shift.values())}
    return out | {f"shift.{name}": value for name, value in named.items()}


def _sizes(bench: Session) -> Numbers:
    """Return the mean flexion moment arms over the session's postures and lengths of the phalanges [mm]."""
    topology, observations = bench.model.finger.topology, bench.observations
    postures = [
        np.asarray(observations.inputs.posture[observations.postures.index(name)])
        for name in dict.fromkeys(observations.postures)
    ]
    arms = zip(topology.segments, mean_moment_arms(bench.model.finger, postures), strict=True)
    out: Numbers = {f"arm.{s.joint}.{s.slip}": float(arm) for s, arm in arms}
    return out | {f"length.{bone}": mm for bone, mm in bench.model.finger.phalanx_lengths_mm().items()}


def _ratios(bench: Session) -> Numbers:
    """Return tension and bone force over tip force of the combined loads, by 3-D norms of predicted forces."""
    observations = bench.observations
    used = zip(observations.roles, observations.locations, strict=True)
    chosen = [i for i, place in enumerate(used) if place == ("validation", "tip")]
    forces = bench.model.predict(observations.inputs).forces
    tip = np.linalg.norm(np.asarray(forces.tip)[chosen, :3], axis=1)
    bone = np.linalg.norm(np.asarray(forces.bone)[chosen], axis=1) / tip
    tension = np.asarray(observations.inputs.tension)[chosen].sum(axis=1) / tip
    return {
        f"{name}.{of}": float(getattr(values, of)())
        for name, values in (("tension", tension), ("bone", bone))
        for of in ("mean", "min", "max")
    }


def _plots() -> list[Plot]:
    """Return the mean human finger under the published model, beside the model before its optimisation."""
    bench = Session.open("synek2019_HMEAN", "synek2019_optimised", catalogue=False)
    before, comparison = comparing.compare(Session.open("synek2019_HMEAN", catalogue=False)), comparing.compare(bench)
    held, spread = ("initial model", before), spread_of(bench, comparison)
    plans = comparison_plans(Compared.of(bench, comparison, held, spread, name="published optimised model"))
    return [Plot(p.name, p.heading, p.draw(), p.caption) for p in plans]


def _unseen(fits: list[SpecimenFit]) -> Sheet:
    """Return errors on the unseen combined loads, predictor by predictor."""
    lines: list[Line] = []
    for fit in fits:
        for key, comparison in fit.comparisons.items():
            known = comparison.select("identification", "tip").errors("sagittal").rmse_N
            tip = comparison.select("validation", "tip").errors("sagittal")
            bone = comparison.select("validation", "bone").errors("sagittal")
            errors = (tip.rmse_N, tip.direction_error_deg, tip.magnitude_error_pct)
            at_bone = (bone.direction_error_deg, bone.magnitude_error_pct)
            lines.append((fit.specimen, PREDICTORS[key], known, *errors, *at_bone))
    notes = [
        "Superposition: measured single-tendon forces added up; no linear model fitted to them can promise better.",
        "Our fit holds where the tip RMSE is at most the published model's, its direction and magnitude at most "
        "the larger of that model's and the superposition limit's, and the bone within 1 deg and 1.5 points of "
        "the published model.",
    ]
    for fit in fits:
        short = [name for name, ok in fit.held_to().items() if not ok]
        held = f"short of: {', '.join(short)}" if short else "our fit holds on the unseen loads"
        notes.append(f"{fit.specimen}: {held}")
    return Sheet(
        "Unseen combined loads, sagittal plane: fitted to single tendons alone",
        ("specimen", "predictor", "fitted RMSE [N]", "tip RMSE [N]", "tip [deg]", "tip [%]", "bone [deg]", "bone [%]"),
        lines,
        notes,
    )


def _fit(session: str, name: str) -> SpecimenFit:
    bench = Session.open(session)
    before = comparing.compare(bench)
    return SpecimenFit(
        name,
        {
            "published_model": comparing.compare(Session.open(session, "synek2019_optimised", catalogue=False)),
            "published_method": _after(bench, "slsqp"),
            "ours": _after(bench, "map"),
            "superposition": superposition(bench.model, bench.observations, before),
        },
    )


def _after(bench: Session, method: Literal["map", "slsqp"]) -> Comparison:
    return compare(bench.model, bench.observations, api.refit(bench, method).theta)
