"""Synek et al. 2019 (PeerJ 7:e7470): every published figure beside ours, then our own fit beside their model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from daq.sessions import read_session
from daq.signals.corrections import measure
from daq.signals.friction import friction
from fingermodel import api, comparing
from fingermodel.comparison.comparison import Comparison, compare
from fingermodel.comparison.superposition import superposition
from fingermodel.scaling import mean_moment_arms
from fingermodel.session import Session
from fingermodel.studies.published import Row, not_available, row
from server.figures.compared import Compared
from server.figures.comparison import comparison_plans
from server.figures.plot import Plot
from server.figures.specimen_spread import spread_of
from server.reproduce.study import Progress, Reproduction, Sheet

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fingermodel.comparison.observations import Observations
    from fingermodel.model import Model

SPECIMENS = ("HMEAN", "H01", "H02", "H03")
FLEXORS = (("DIP", "FDP"), ("PIP", "FDP"), ("MCP", "FDP"), ("PIP", "FDS"), ("MCP", "FDS"))
PREDICTORS = {
    "published_model": "published optimised model",
    "published_method": "published method, this specimen",
    "ours": "our fit (map)",
    "superposition": "superposition limit",
}
NO_POINTS = "not available: the bonobo's tendon points are not among the published data; ours are human points scaled"


@dataclass(frozen=True)
class SpecimenFit:
    """Unseen combined loads of one specimen under four predictors.

    Attributes:
        specimen: name.
        comparisons: published model as recomputed, published method, our fit, superposition limit.
    """

    specimen: str
    comparisons: dict[str, Comparison]

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
        """Whether our fit does what it should on loads that were never fitted.

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
    """Every published figure beside ours."""
    mean = Session.open("synek2019_HMEAN", catalogue=False)
    optimised = Session.open("synek2019_HMEAN", "synek2019_optimised", catalogue=False)
    rows = [*_friction_rows(), *_identification_rows(mean, optimised), *_shift_rows(mean, optimised)]
    return [*rows, *_arm_rows(optimised), *_validation_rows(optimised), *_ratio_rows(optimised), *_bonobo_rows()]


def _plots() -> list[Plot]:
    """The mean human finger under the published model, beside the model before its optimisation."""
    bench = Session.open("synek2019_HMEAN", "synek2019_optimised", catalogue=False)
    before, comparison = comparing.compare(Session.open("synek2019_HMEAN", catalogue=False)), comparing.compare(bench)
    held, spread = ("initial model", before), spread_of(bench, comparison)
    plans = comparison_plans(Compared.of(bench, comparison, held, spread, name="published optimised model"))
    return [Plot(p.name, p.heading, p.draw(), p.caption) for p in plans]


def _unseen(fits: list[SpecimenFit]) -> Sheet:
    """Errors on the unseen combined loads, predictor by predictor."""
    lines: list[tuple[str | float | None, ...]] = []
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
        tuple(lines),
        tuple(notes),
    )


def _friction_rows() -> list[Row]:
    result = friction([measure(read_session(f"synek2019_{s}")) for s in ("H01", "H02", "H03", "B01")])
    return [
        row("friction factor c (Eq 1)", "0.835", result.factor, "1"),
        row("load cases behind c", "32", result.n, "1"),
    ]


def _identification_rows(mean: Session, optimised: Session) -> list[Row]:
    initial = comparing.compare(mean).select("identification", "tip")
    best = comparing.compare(optimised).select("identification", "tip")
    refitted = _after(mean, "slsqp").select("identification", "tip")
    rows = []
    for name, comparison, rmse, relative in (
        ("initial model", initial, "0.53", "52.10"),
        ("published optimised model", best, "0.11", "10.73"),
        ("identification run again (SLSQP, Eq 5)", refitted, "0.11", "10.73"),
    ):
        e = comparison.errors("sagittal")
        rows.append(row(f"human tip force RMSE, {name}", rmse, e.rmse_N or np.nan, "N"))
        rows.append(row(f"human relative RMSE (Eq 7), {name}", relative, e.rmse_rel_pct or np.nan, "%"))
    for muscle, value in (("FDP", "0.08"), ("FDS", "0.15")):
        e = best.select(muscles=muscle).errors("sagittal")
        rows.append(row(f"human RMSE of {muscle}, optimised", value, e.rmse_N or np.nan, "N"))
    for muscle, value in (("LU", "77.84"), ("FDP", "3.55")):
        e = best.select(muscles=muscle).errors("sagittal")
        rows.append(row(f"human relative RMSE of {muscle}, optimised", value, e.rmse_rel_pct or np.nan, "%"))
    return rows


def _shift_rows(mean: Session, optimised: Session) -> list[Row]:
    shift: dict[tuple[str, str, str], list[float]] = {}
    for name, before, after in zip(
        mean.model.parameters.names, mean.model.initial, optimised.model.initial, strict=True
    ):
        parts = name.split(".")
        if parts[0] == "point" and parts[4] != "z":
            shift.setdefault((parts[1], parts[2], parts[4]), []).append(abs(float(after - before)))

    def average(**where: str) -> float:
        keys = ("joint", "slip", "axis")
        return float(
            np.mean(
                [x for key, v in shift.items() for x in v if all(key[keys.index(k)] == w for k, w in where.items())]
            )
        )

    return [
        row("mean shift of the human via points", "0.92", average(), "mm"),
        row("mean shift along x", "0.89", average(axis="x"), "mm"),
        row("mean shift along y", "0.96", average(axis="y"), "mm"),
        row("mean shift at the MCP", "1.57", average(joint="MCP"), "mm"),
        row("mean shift at the DIP", "0.42", average(joint="DIP"), "mm"),
        row("mean shift of RI at the MCP", "4.06", average(joint="MCP", slip="RI"), "mm"),
        row("largest shift of a coordinate", "9.00", max(x for v in shift.values() for x in v), "mm"),
    ]


def _arm_rows(optimised: Session) -> list[Row]:
    arms = _mean_arms(optimised)
    published = dict(zip(FLEXORS, ("4.3", "11.1", "12.1", "7.3", "12.8"), strict=True))
    rows = [row(f"human mean moment arm of {s} at the {j}", published[j, s], arms[j, s], "mm") for j, s in FLEXORS]
    lengths = optimised.model.finger.phalanx_lengths_mm()
    return rows + [
        row(f"human {bone} length", text, lengths[bone], "mm") for bone, text in (("MP", "28.8"), ("PP", "47.0"))
    ]


def _mean_arms(bench: Session) -> dict[tuple[str, str], float]:
    topology, observations = bench.model.finger.topology, bench.observations
    postures = [
        np.asarray(observations.inputs.posture[observations.postures.index(name)])
        for name in dict.fromkeys(observations.postures)
    ]
    arms = mean_moment_arms(bench.model.finger, postures)
    return {(s.joint, s.slip): float(arm) for s, arm in zip(topology.segments, arms, strict=True)}


def _validation_rows(optimised: Session) -> list[Row]:
    comparison = comparing.compare(optimised)
    rows = []
    for location, numbers in (("tip", ("3.10", "0.25", "11.03")), ("bone", ("3.32", "0.16", "2.34"))):
        e = comparison.select("validation", location).errors("sagittal")
        ours = (e.direction_error_deg, e.magnitude_error_N, e.magnitude_error_pct)
        for what, text, value, unit in zip(
            ("direction error", "magnitude error", "relative magnitude error"),
            numbers,
            ours,
            ("deg", "N", "%"),
            strict=True,
        ):
            rows.append(row(f"human combined loads, {location}: {what}", text, value or np.nan, unit))
    return rows


def _ratios(model: Model, observations: Observations) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tension to tip force and bone force to tip force of the combined loads, 3-D norms of predicted forces."""
    chosen = [
        i for i, role in enumerate(observations.roles) if role == "validation" and observations.locations[i] == "tip"
    ]
    forces = model.predict(observations.inputs).forces
    tip = np.linalg.norm(np.asarray(forces.tip)[chosen, :3], axis=1)
    bone = np.linalg.norm(np.asarray(forces.bone)[chosen], axis=1)
    return np.asarray(observations.inputs.tension)[chosen].sum(axis=1) / tip, bone / tip


def _ratio_rows(optimised: Session) -> list[Row]:
    tension, bone = _ratios(optimised.model, optimised.observations)
    return [
        row("human tension to tip force, mean", "3.78", float(tension.mean()), "1"),
        row("human tension to tip force, least", "3.54", float(tension.min()), "1"),
        row("human tension to tip force, most", "4.10", float(tension.max()), "1"),
        row("human bone to tip force, mean", "2.87", float(bone.mean()), "1"),
        row("human bone to tip force, least", "2.55", float(bone.min()), "1"),
        row("human bone to tip force, most", "3.15", float(bone.max()), "1"),
    ]


def _bonobo_rows() -> list[Row]:
    bench = Session.open("synek2019_B01", catalogue=False)
    before = comparing.compare(bench)
    after = _after(bench, "map")
    tension, bone = _ratios(bench.model, bench.observations)
    arms = _mean_arms(bench)
    lengths = bench.model.finger.phalanx_lengths_mm()
    first, last = before.select("identification").errors("sagittal"), after.select("identification").errors("sagittal")
    tip = after.select("validation", "tip").errors("sagittal")
    at_bone = after.select("validation", "bone").errors("sagittal")
    rows = [
        not_available(f"bonobo {quantity}", text, ours, unit, NO_POINTS)
        for quantity, text, ours, unit in (
            ("tip force RMSE, initial", "0.69", first.rmse_N, "N"),
            ("relative RMSE, initial", "112.15", first.rmse_rel_pct, "%"),
            ("tip force RMSE, optimised", "0.20", last.rmse_N, "N"),
            ("relative RMSE, optimised", "33.24", last.rmse_rel_pct, "%"),
            ("combined loads, tip: direction error", "5.76", tip.direction_error_deg, "deg"),
            ("combined loads, tip: magnitude error", "0.2", tip.magnitude_error_N, "N"),
            ("combined loads, tip: relative magnitude error", "11.70", tip.magnitude_error_pct, "%"),
            ("combined loads, bone: direction error", "0.57", at_bone.direction_error_deg, "deg"),
            ("combined loads, bone: magnitude error", "0.26", at_bone.magnitude_error_N, "N"),
            ("combined loads, bone: relative magnitude error", "4.10", at_bone.magnitude_error_pct, "%"),
            ("tension to tip force, mean", "5.36", float(tension.mean()), "1"),
            ("tension to tip force, least", "5.06", float(tension.min()), "1"),
            ("tension to tip force, most", "5.66", float(tension.max()), "1"),
            ("bone to tip force, mean", "4.44", float(bone.mean()), "1"),
            ("bone to tip force, least", "4.19", float(bone.min()), "1"),
            ("bone to tip force, most", "4.68", float(bone.max()), "1"),
        )
    ]
    given = "given: our bonobo is built from it"
    published = dict(zip(FLEXORS, ("3.9", "10.4", "12.9", "6.6", "13.3"), strict=True))
    rows += [
        not_available(f"bonobo mean moment arm of {s} at the {j}", published[j, s], arms[j, s], "mm", given)
        for j, s in FLEXORS
    ]
    return rows + [
        not_available(f"bonobo {name} length", text, lengths[name], "mm", given)
        for name, text in (("MP", "38.1"), ("PP", "57.8"))
    ]


def _fit(session: str, name: str) -> SpecimenFit:
    bench = Session.open(session, catalogue=False)
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
