"""One session's diagnosis: search, weigh, judge, and question the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fingermodel.compare import Comparison, compare
from fingermodel.diagnosis.beyond import known_beyond
from fingermodel.diagnosis.candidates import Candidate, candidates_of
from fingermodel.diagnosis.confounding import Confounding, confounding
from fingermodel.diagnosis.evidence import Evidence, Weighed, best_form, weigh
from fingermodel.diagnosis.held_out import HeldOut
from fingermodel.diagnosis.hints import Hint, hints
from fingermodel.diagnosis.nulls import Null, moments_violated, nulls
from fingermodel.diagnosis.nulls_frames import rig_mistake
from fingermodel.diagnosis.robustness import Robustness, robustness
from fingermodel.diagnosis.search import Search, Searcher
from fingermodel.diagnosis.verdict import LEAST_CASES, SURE, Verdict, judge
from fingermodel.diagnosis.wildcard import AMPLITUDES_N, Wildcard, anything
from fingermodel.fingers import Plane
from fingermodel.model import Model
from fingermodel.observations import Observations
from fingermodel.problems import Problem, map_problem

Floats = NDArray[np.float64]

# Why a finding does not stand that nothing could have refuted.
UNTESTED = (
    "no case was kept from the fit to test it: every case has the role identification; give some, such as combined "
    "loads, role: validation"
)
# What is said of a case that is missed with an effect which all others bear out.
UNSHOWN = (
    "far more than noise and an error of the effect's form would make: something acts there too that what was fitted "
    "does not show. Give such a case the role identification, and keep others from the fit."
)
# Rigs of which most lie within their budget seldom pass this multiple of it.
LARGE_BUDGET = 2.0


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found out about one session.

    Attributes:
        problem: the readings and the base model.
        candidates: that were searched.
        search: every fit.
        evidence: probabilities.
        confounding: what the protocol cannot tell apart.
        verdict: with its reasons.
        robustness: what it hangs on.
        hints: formulas, where nothing fits.
        nulls: what the readings say without any model.
        seconds: of the computation.
        comparisons: by explanation's names, of every explanation that was weighed.
    """

    problem: Problem
    candidates: tuple[Candidate, ...]
    search: Search
    evidence: Evidence
    confounding: Confounding
    verdict: Verdict
    robustness: Robustness
    hints: tuple[Hint, ...]
    nulls: tuple[Null, ...]
    seconds: float
    comparisons: dict[tuple[str, ...], Comparison] = field(repr=False)

    @property
    def best(self) -> Weighed:
        """What the verdict would add: the named explanation, or else the most probable one."""
        if self.verdict.names and self.verdict.kind in ("found", "undecided"):
            named = best_form(self.evidence, self.verdict.names)
            if named is not None:
                return named
        if self.verdict.kind in ("nothing_missing", "none_of_catalogue"):
            return self.evidence.nothing
        return self.evidence.weighed[0]

    def validation_rmse(self, weighed: Weighed) -> float | None:
        """RMSE [N] of the cases that were never fitted, in the plane that the finger is judged in."""
        return validation_rmse(self.problem, self.comparisons[weighed.explanation.names])


def diagnose(
    model: Model,
    observations: Observations,
    *,
    plane: Plane | None = None,
    held: Sequence[str] = (),
    start: Floats | None = None,
    thorough: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Diagnosis:
    """Find out what is missing.

    Args:
        model: with the whole catalogue among its effects, all at their null.
        observations: of the session.
        plane: of the forces that count; by default what the finger's axes can predict.
        held: parameters of effects that the model has already; they are free throughout, and no candidates.
        start: (parameters,) of an earlier fit, as one more start.
        thorough: more starts and pairs, and refits without each part of the data.
        progress: is told the share done.
    """
    began = time.perf_counter()
    problem = map_problem(model, observations, plane, held)
    had = {name.split(".")[0] for name in held}
    every = candidates_of(model, sagittal=(plane or model.finger.judged_in) == "sagittal")
    candidates = tuple(c for c in every if c.effect not in had)
    search = Searcher(problem, progress).run(candidates, start, thorough)
    wildcard = Wildcard.of(anything(problem), AMPLITUDES_N)
    evidence = weigh(problem, search, candidates, wildcard, known_beyond(search.nothing, candidates, had))
    alike = confounding(search.nothing.everything, candidates)
    comparisons = {
        w.explanation.names: compare(model, observations, w.fitted.theta) for w in reversed(evidence.weighed)
    }
    held_out = HeldOut(problem, candidates)
    verdict = judge(
        problem,
        evidence,
        candidates,
        alike,
        lambda w: validation_rmse(problem, comparisons[w.explanation.names]),
        lambda: held_out.counted_in(evidence, wildcard),
    )
    verdict = enough(problem, verdict)
    questioned = robustness(problem, evidence, verdict, wildcard, candidates, thorough=thorough)
    tested = nulls(model, observations)
    at_cell = {effect.name for effect in model.effects if effect.stage == "reading"}
    effect_of = {c.name: c.effect for c in candidates}
    p_at_cell = sum(
        p for names, p in evidence.probability.items() if any(effect_of[name] in at_cell for name in names or ())
    )
    moments = (False, False)
    closure = any(n.name == "moments_closure" and n.verdict == "violated" for n in tested)
    if closure and verdict.kind in ("found", "one_of"):
        # Where the budget fits only if it is larger than stated, so may be the moments that a rig within it shows.
        fits = evidence.weighed[0].budget_factor
        moments = (
            moments_violated(model, observations, fits),
            moments_violated(model, observations, LARGE_BUDGET),
        )
    verdict = _settled(verdict, questioned, moments, candidates, p_at_cell)
    verdict = _with_missed(verdict, evidence, held_out)
    found: tuple[Hint, ...] = ()
    if verdict.kind in ("none_of_catalogue", "undecided"):
        if mistake := rig_mistake(model, observations):
            # To be put right in the session; a formula would only make up for it.
            verdict = replace(verdict, reasons=(f"{mistake[0].upper()}{mistake[1:]}.", *verdict.reasons))
        else:
            # Where no effect stands, a formula is to stand alone; else it is to stand beside the likeliest.
            ground = evidence.nothing if verdict.kind == "none_of_catalogue" else evidence.weighed[0]
            found = hints(problem, ground.fitted)
    return Diagnosis(
        problem,
        candidates,
        search,
        evidence,
        alike,
        verdict,
        questioned,
        found,
        tested,
        time.perf_counter() - began,
        comparisons,
    )


def _with_missed(verdict: Verdict, evidence: Evidence, held_out: HeldOut) -> Verdict:
    """Nothing is missing only where no case that was never fitted is missed; beside a finding such a case is told."""
    if verdict.kind not in ("nothing_missing", "found"):
        return verdict
    named = best_form(evidence, verdict.names)
    missed = held_out.most_missed(named) if named is not None else None
    if missed is None or not missed.surprising:
        return verdict
    if verdict.kind == "found":
        return replace(verdict, reasons=(*verdict.reasons, f"{missed.text}, {UNSHOWN}"))
    return replace(verdict, kind="undecided", reasons=(), short=(*verdict.short, missed.text))


def validation_rmse(problem: Problem, comparison: Comparison) -> float | None:
    """RMSE [N] of the validation cases, in the plane that the finger is judged in."""
    return comparison.select(role="validation").errors(problem.model.finger.judged_in).rmse_N


def enough(problem: Problem, verdict: Verdict) -> Verdict:
    """A few cases, one posture, or none that was kept from the fit carry no verdict that names anything."""
    observations = problem.observations
    cases = [i for i in np.unique(problem.rows // 6) if observations.roles[i] == "identification"]
    if len(cases) < LEAST_CASES:
        short = f"{len(cases)} identification cases are too few to decide anything (at least {LEAST_CASES})"
        return replace(verdict, kind="undecided", effects=(), reasons=(), short=(short,))
    if len({observations.postures[i] for i in cases}) < 2 and verdict.kind == "found":
        short = "all cases were taken in one posture: what depends on posture cannot be told from what does not"
        return replace(verdict, kind="undecided", effects=(), short=(*verdict.short, short))
    if "validation" not in observations.roles and verdict.kind == "found":
        return replace(verdict, kind="undecided", effects=(), short=(*verdict.short, UNTESTED))
    return verdict


def _settled(
    verdict: Verdict,
    questioned: Robustness,
    moments: tuple[bool, bool],
    candidates: tuple[Candidate, ...],
    p_at_cell: float,
) -> Verdict:
    """A verdict that another assumption would turn is undecided; so is one that a test without any model contradicts.

    Moments at the tip that nothing in the catalogue makes are something else, whatever explains the forces: `moments`
    says whether there are such for a rig with the budget that fits, and for one with a large one.
    """
    if verdict.kind not in ("found", "one_of"):
        return verdict
    short = list(verdict.short)
    if questioned.flips_when:
        short.append(f"it would be another if {questioned.flips_when[0]}")
    clamp = {c.name for c in candidates if c.rests_on_clamp_assumption}
    expected = " and ".join(sorted(verdict.names))
    planar = " and ".join(sorted((questioned.sagittal_alone or "").split(" and ")))
    if clamp & set(verdict.names) and expected != planar:
        short.append("only out-of-plane forces support it, which the clamp carries in part")
    # Mx and My at the tip are not fitted: the model's clamp carries none, and only what acts at the cell can show any.
    if moments[0]:
        if questioned.rests_on_moments:
            short.append("only the tip's moment says so, and the clamp carries moments that the model does not know")
        elif p_at_cell <= 1.0 - SURE and moments[1]:
            reason = (
                f"{' or '.join(verdict.names)} would explain the forces, but the tip's clamp carries moments that no "
                "likely effect here makes."
            )
            return replace(
                verdict,
                kind="none_of_catalogue",
                names=(),
                effects=(),
                probability=1.0 - p_at_cell,
                reasons=(reason, *verdict.reasons),
            )
        elif p_at_cell < SURE:
            short.append("the tip's clamp carries moments that nothing named here makes for certain")
    if len(short) == len(verdict.short):
        return verdict
    return replace(verdict, kind="undecided", effects=(), short=tuple(short))
