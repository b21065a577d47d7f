"""The load cases that would best tell the live explanations apart, and what each expects of them.

Every explanation predicts a case as a Gaussian, from its linearised model and the noise of readings like those taken;
the posture is set anew for it. A case is worth the mutual information between explanation and reading (Lindley
1956; Box and Hill 1967 and Buzzi-Ferraris and Forzatti 1984 are the published cross-checks).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats
from fingermodel.comparison.comparison import muscles_of
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import free_mask
from fingermodel.diagnosis.session_model.case_noise import as_read, by_case
from fingermodel.diagnosis.settings import LEVER_MM, LIVE, SEED, WORTH_NAT
from fingermodel.fitting.identification import slopes_of
from fingermodel.fitting.roots import root_of
from fingermodel.stages import LoadCaseInput

DRAWS = 48
OFFERED = 5
# Between the names of effects that act together.
BOTH = " + "


@dataclass(frozen=True)
class PlannedReading:
    """A load case that could be run."""

    posture: str
    location: str
    masses_g: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """As an answer gives it."""
        return {"posture": self.posture, "location": self.location, "masses_g": self.masses_g}

    @property
    def words(self) -> str:
        """Which tendons in which posture at which mount."""
        return f"{muscles_of(self.masses_g)} in {self.posture} at the {self.location}"


@dataclass(frozen=True, eq=False)
class NextCase:
    """A load case and what it would tell."""

    case: PlannedReading  # what to hang where
    information_nat: float  # between explanation and reading
    separates: tuple[str, ...]  # names of the explanations that it parts best
    expected_probability: float  # of whichever explanation is true, afterwards
    # By explanation: mean (components,) and standard deviation, reading's noise included.
    predictions: dict[str, tuple[Floats, Floats]]
    tests: bool  # whether two explanations are taken as equally probable before it, whatever the session says of them

    def as_dict(self) -> dict[str, Any]:
        """As the answer gives it."""
        before = "if both are equally probable before, " if self.tests else ""
        return self.case.as_dict() | {
            "information_nat": self.information_nat,
            "separates": list(self.separates),
            "expected_probability": self.expected_probability,
            "predictions": {
                name: {
                    "mean_N": mean[:3].tolist(),
                    "sd_N": np.sqrt(np.diag(covariance))[:3].tolist(),
                    "mean_Mz_Nmm": float(mean[3]) if len(mean) > 3 else None,
                    "sd_Mz_Nmm": float(np.sqrt(covariance[3, 3])) if len(mean) > 3 else None,
                }
                for name, (mean, covariance) in self.predictions.items()
            },
            "text": f"{self.case.words}: would part "
            f"{' from '.join(self.separates[:2])} ({self.information_nat:.2f} nat; {before}probability of the true one "
            f"{self.expected_probability:.2f} afterwards)",
        }


@dataclass(frozen=True, eq=False)
class Plan:
    """What to measure next."""

    cases: tuple[NextCase, ...]  # best first; none where no available load case separates anything
    # That were held against each other, with their probabilities; 0.5 each where one is tested.
    explanations: dict[str, float]
    instruments: tuple[str, ...]  # what else would separate them
    text: str  # one plain sentence


def name_of(fit: Optimum) -> str:
    """`hanger_mass + bowstringing`, or `nothing missing`."""
    return BOTH.join(fit.explanation.names) or "nothing missing"


def live_explanations(diagnosis: Diagnosis) -> dict[str, tuple[Optimum, float]]:
    """Explanations that are still possible.

    A finding is tested against itself less a member, a single effect against nothing missing, both equally probable.
    With something more, it predicts nearly the same.
    """
    posterior, best = diagnosis.posterior, diagnosis.best
    out: dict[str, tuple[Optimum, float]] = {}
    for names, p in sorted(posterior.of_explanations().items(), key=lambda item: -item[1]):
        fit = None if names is None else posterior.best_fit(names)
        if fit is not None and p >= LIVE:
            out[name_of(fit)] = (fit, p)
    if len(out) < 2 or diagnosis.verdict.kind == "found":
        if best.explanation.size == 0:
            named = [f for f in posterior.fits.values() if f.explanation.size]
            best = max(named, key=lambda f: f.log_posterior, default=best)
        whole, size = set(best.explanation.names), best.explanation.size
        less = [f for e, f in posterior.fits.items() if e.size == size - 1 and set(e.names) < whole]
        rival = max(less, key=posterior.weight, default=posterior.nothing)
        out = {name_of(best): (best, 0.5), name_of(rival): (rival, 0.5)}
    total = sum(p for _, p in out.values())
    return {name: (fit, p / total) for name, (fit, p) in out.items()}


def hung(diagnosis: Diagnosis) -> list[dict[str, float]]:
    """What hung in each case [g] by tendon; in a suspect one nobody knows."""
    suspects = diagnosis.suspects
    return [m for case, m in enumerate(diagnosis.session.observations.masses_g) if case not in suspects]


def largest_loads(diagnosis: Diagnosis) -> dict[str, float]:
    """Largest mass [g] that hung on each tendon."""
    out: dict[str, float] = {}
    for masses in hung(diagnosis):
        for muscle, mass in masses.items():
            out[muscle] = max(out.get(muscle, 0.0), mass)
    return out


def feasible(diagnosis: Diagnosis) -> list[PlannedReading]:
    """Postures, mounts and tendons of the session; each tendon alone, at full and half load, and in twos.

    What was read already is left out, but for suspects: what a case has taught tests nothing.
    """
    observations, suspects = diagnosis.session.observations, diagnosis.suspects
    used = [i for i, role in enumerate(observations.roles) if role != "check"]
    postures = list(dict.fromkeys(observations.postures[i] for i in used))
    locations = list(dict.fromkeys(observations.locations[i] for i in used))
    largest = largest_loads(diagnosis)
    loads = [{muscle: part} for muscle, mass in largest.items() for part in (mass, round(mass / 2.0))]
    # No more than the rig has ever carried at once.
    limit = max(sum(masses.values()) for masses in hung(diagnosis)) + 1e-9
    pairs = combinations(largest, 2)
    loads += [{a: largest[a], b: largest[b]} for a, b in pairs if largest[a] + largest[b] <= limit]
    planned = [PlannedReading(p, place, masses) for p in postures for place in locations for masses in loads]
    read = {
        _hanging(observations.postures[i], observations.locations[i], observations.masses_g[i])
        for i in used
        if i not in suspects
    }
    return [c for c in planned if _hanging(c.posture, c.location, c.masses_g) not in read]


def _hanging(posture: str, location: str, masses_g: Mapping[str, float]) -> tuple[object, ...]:
    """What a case is, its masses to a gram."""
    return posture, location, frozenset((muscle, round(mass)) for muscle, mass in masses_g.items())


def plan_next(diagnosis: Diagnosis, cases: Sequence[PlannedReading] | None = None) -> Plan:
    """Rank the load cases that the rig could run, by default what it has shown that it can, by what they would tell."""
    if diagnosis.faults:
        return Plan((), {}, (), "No load case tests an explanation before the session is corrected.")
    if diagnosis.verdict.kind == "none_of_catalogue":
        return Plan((), {}, (), "No explanation stands, so no load case can test one: add a formula first.")
    live = live_explanations(diagnosis)
    cases = feasible(diagnosis) if cases is None else cases
    names = list(live)
    prior = np.array([p for _, p in live.values()])
    rng = np.random.default_rng(SEED)
    tests = prior.tolist() == [0.5, 0.5]
    out, inputs, read = [], inputs_of(diagnosis, cases), [0, 1, 2, 5]
    predicted = {name: expected(fit, inputs, read) for name, (fit, _) in live.items()} if cases else {}
    moments = bool(np.any(diagnosis.session.rows % 6 == 5))
    for i, case in enumerate(cases):
        components = [0, 1, 2, 3] if case.location == "tip" and moments else [0, 1, 2]
        each = {n: (predicted[n][0][i, components], predicted[n][1][i][np.ix_(components, components)]) for n in names}
        told, probability = information([each[n] for n in names], prior, rng)
        out.append(NextCase(case, told, _parted(names, each, prior), probability, each, tests))
    out.sort(key=lambda c: -c.information_nat)
    best = tuple(c for c in _varied(out) if c.information_nat >= WORTH_NAT)[:OFFERED]
    acting = [m.candidate for fit, _ in live.values() for m in fit.explanation.members]
    instruments = tuple(dict.fromkeys(f"{c.shown_by} ({c.effect})" for c in acting if c.shown_by))
    if best:
        text = f"Next: {best[0].as_dict()['text']}."
    else:
        instead = f"; instead, {'; or '.join(instruments)}" if instruments else ""
        text = f"No available load case separates {' and '.join(names)}{instead}."
    return Plan(best, {n: float(p) for n, p in zip(names, prior, strict=True)}, instruments, text)


def _varied(cases: Sequence[NextCase]) -> list[NextCase]:
    """The best case of each posture, mount and set of tendons."""
    best: dict[tuple[str, str, str], NextCase] = {}
    for c in cases:
        best.setdefault((c.case.posture, c.case.location, muscles_of(c.case.masses_g)), c)
    return list(best.values())


def inputs_of(diagnosis: Diagnosis, cases: Sequence[PlannedReading]) -> LoadCaseInput:
    """The cases as the model sees them: settings and mountings as they were last in the session."""
    model, observations = diagnosis.session.model, diagnosis.session.observations
    layout, muscles = observations.layout, model.finger.topology.muscles
    weight = float(np.asarray(observations.inputs.weight).max())
    masses_g = [[case.masses_g.get(muscle, 0.0) for muscle in muscles] for case in cases]
    settings = {name: k for k, (name, _) in enumerate(layout.settings)}
    mountings = {name: k for k, (name, _) in enumerate(layout.mountings)}
    n = len(cases)
    return LoadCaseInput.batch(
        posture=[observations.posture_angles[c.posture] for c in cases],
        tension=weight * np.array(masses_g).reshape(len(cases), len(muscles)),
        at_bone=[c.location == "bone" for c in cases],
        known_force=np.zeros((n, 3)),
        is_check=np.zeros(n, bool),
        setting=[settings[c.posture] for c in cases],
        mounting=[mountings[c.location] for c in cases],
        weight=np.full(n, weight),
        unloading=np.zeros(n, bool),
        since_tare=np.full(n, 0.02),
        elapsed=np.full(n, 1.0),
    )


def expected(fit: Optimum, inputs: LoadCaseInput, read: Sequence[int], anew: float = 1.0) -> tuple[Floats, Floats]:
    """Mean (cases, L) and covariance (cases, L, L) of some components under an explanation, noise included.

    Args:
        fit: of the explanation.
        inputs: the cases.
        read: (L,) which components.
        anew: of how many of their widths the angles are unknown, since the posture will be set anew.
    """
    session, values, count = fit.session, fit.hyper.values(fit.best), len(np.asarray(inputs.tension))
    theta, covariance, index = fit.parameter_posterior(fit.best)
    free = replace(session.problem, free=session.problem.free | free_mask(session.model, fit.explanation))
    mean = np.asarray(session.model.predict(inputs, theta).reading)[:, read]
    rows = (6 * np.arange(count)[:, None] + np.array(read)).reshape(-1)
    slopes = slopes_of(free, theta, rows, inputs).reshape(count, len(read), -1)[:, :, index]
    angle = np.array([session.model.parameters.names[i].startswith("posture_angle.") for i in index])
    rest, angles = slopes[:, :, ~angle], slopes[:, :, angle]
    known = rest @ covariance[np.ix_(~angle, ~angle)] @ rest.swapaxes(1, 2) + anew**2 * angles @ angles.swapaxes(1, 2)
    unit = np.where(np.array(read) < 3, 1.0, LEVER_MM)
    variance = np.nanmedian(np.diagonal(session.observations.case_covariance, axis1=1, axis2=2), axis=0)[read]
    usual = np.where(np.isfinite(variance), variance, np.nanmedian(variance / unit**2) * unit**2)
    noise = as_read(np.diag(usual), unit, values.errors.noise, session.observations.noise_assumed)
    return mean, known + by_case(mean, unit, values.errors, values.groups) + noise + 1e-9 * np.eye(len(read))


def information(
    each: Sequence[tuple[Floats, Floats]], prior: Floats, rng: np.random.Generator, draws: int = DRAWS
) -> tuple[float, float]:
    """Mutual information [nat] between explanation and reading, and the true one's expected probability afterwards.

    Args:
        each: mean and covariance of the reading by every explanation.
        prior: probability of each.
        rng: to draw with.
        draws: of each explanation.
    """
    means, factors = np.array([m for m, _ in each]), root_of(np.array([c for _, c in each]))
    true, (count, length) = np.arange(len(each)), means.shape
    # Readings (true explanation, draw, component), and their log density under every explanation, which comes last.
    y = means[:, None] + rng.normal(size=(count, draws, length)) @ factors.swapaxes(1, 2)
    z = np.einsum("jab,kdjb->kdja", np.linalg.inv(factors), y[:, :, None] - means, optimize=True)
    logs = -0.5 * (z**2).sum(axis=-1) - np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    weighted = logs + np.log(np.maximum(prior, 1e-300))
    evidence = logsumexp(weighted, axis=2)
    told = (logs[true, :, true] - evidence).mean(axis=1)
    rightly = np.exp(weighted[true, :, true] - evidence).mean(axis=1)
    return max(float(prior @ told), 0.0), min(float(prior @ rightly), 1.0)


def _parted(names: Sequence[str], each: dict[str, tuple[Floats, Floats]], prior: Floats) -> tuple[str, ...]:
    """The two explanations that a case parts best, weighed by how probable both are."""

    def parted(pair: tuple[int, ...]) -> float:
        (a, of_a), (b, of_b) = (each[names[k]] for k in pair)
        distance = float((a - b) @ np.linalg.solve(of_a + of_b, a - b))
        return float(min(prior[k] for k in pair)) * distance / (1.0 + distance)

    best = max(combinations(range(len(names)), 2), key=parted, default=(0,))
    return tuple(names[k] for k in best)
