"""Simulation-based calibration: sessions drawn from the very priors that a diagnosis assumes.

    python -m benchmarks.calibration [--draws 100] [--session DEV-01] [--seed-from COMMIT] [--out FILE]

The model of a session is drawn whole: what acts, parameters, errors of form, something smooth, scatter, noise, bad
cases, budget and anatomy with their multiples. If the inference is right, the rank of each true value within its
posterior is uniform (Talts et al. 2018, arXiv 1804.06788), and what has a probability p comes true with p.
The evidence counts whole here, where a verdict discounts it: of these sessions the model is true. Writes
`benchmarks/calibration.md`, and every draw beside it as JSON lines.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr
from scipy.stats import kstest

from benchmarks.machine import commit, publish
from benchmarks.random_worlds import base_seed
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.diagnose import diagnose
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import (
    ANATOMY,
    ANGLE,
    BUDGET,
    COMPONENT,
    DIRECTION,
    FORMS,
    GROUP,
    GROUPS,
    NOISE,
    SCATTER,
    SMOOTH,
    Hyperparameters,
    Node,
)
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation
from fingermodel.diagnosis.session_model.session import Session, session_of
from fingermodel.diagnosis.settings import P_BAD, P_NOTHING, P_SIZES
from fingermodel.session import Session as Bench

Floats = NDArray[np.float64]
Rng = np.random.Generator
AXES = {
    "scatter": SCATTER,
    "noise": NOISE,
    "component": COMPONENT,
    "direction": DIRECTION,
    "angle": ANGLE,
    "budget_multiple": BUDGET,
    "anatomy_multiple": ANATOMY,
    **{name: GROUP + k for k, name in enumerate(GROUPS)},
    "smooth": SMOOTH,
}
KINDS: tuple[Literal["budget"], Literal["anatomy"]] = ("budget", "anatomy")
BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)


class Priors:
    """A session's cases, and everything that its readings may be made of.

    Args:
        name: of a shipped session, or its folder.
    """

    def __init__(self, name: str) -> None:
        bench = Bench.open(name)
        self.model, self.entered = bench.model, bench.observations
        self._session: Session = session_of(self.model, self.entered)
        self._hyper = Hyperparameters.of(self._session)
        self._candidates = Candidates.of(self.model, sagittal=self._session.plane == "sagittal")

    def drawn(self, rng: Rng) -> tuple[Observations, Explanation, Node, Floats]:
        """Draw a session: its readings, what acts, its hyperparameters, and its parameters (parameters,)."""
        session, hyper, table = self._session, self._hyper, self.model.parameters
        explanation = self._explanation(rng)
        axes = (*hyper.axes, *[hyper.form] * sum(m.candidate.has_form for m in explanation.members))
        node = hyper.plainly(tuple(int(rng.choice(len(axis.values), p=_normalised(axis.log_weight))) for axis in axes))
        values, problem = hyper.values(node), session.problem
        multiple = {"budget": values.budget, "anatomy": values.anatomy, "effect": 1.0}
        free = problem.free.copy()
        free[list(explanation.parameters)] = True
        theta = problem.centre.copy()
        for i in np.flatnonzero(free):
            width = multiple[table.parameters[i].kind] * problem.scale[i]
            while True:
                z = rng.normal() * width
                theta[i] = problem.centre[i] + (abs(z) if table.one_sided[i] else z)
                if problem.lower[i] <= theta[i] <= problem.upper[i]:
                    break
        return self._readings(rng, explanation, node, theta), explanation, node, theta

    def _explanation(self, rng: Rng) -> Explanation:
        """No effect, or up to three; as probable as the priors have these."""
        if rng.random() < P_NOTHING:
            return NOTHING
        singles, size = self._candidates.singles, 1 + int(rng.choice(len(P_SIZES), p=P_SIZES))
        weight = _normalised(np.array([self._candidates.log_prior(e) for e in singles]))
        while True:
            members = [singles[k].members[0] for k in rng.choice(len(singles), size, p=weight)]
            found = self._candidates.joined(members)
            if found is not None:
                return found

    def _readings(self, rng: Rng, explanation: Explanation, node: Node, theta: Floats) -> Observations:
        session = self._session.seen_from(theta)
        values = self._hyper.values(node)
        fit = Fitter(session, self._candidates, self._hyper).linearised(explanation, theta, node, frozenset(), 0.0)
        reading = np.asarray(self.model.predict(self.entered.inputs, theta).reading).reshape(-1)[session.rows]
        smooth = [width * session.changes.smooth(name) for name, width in self._hyper.smooth_blocks(node).items()]
        blocks = [session.changes.tares, values.budget * session.changes.nuisances, *smooth]
        blocks += [error * form for error, form in zip(values.forms, fit.form_errors, strict=True)]
        columns = np.concatenate(blocks, axis=1)
        reading = reading + columns @ rng.normal(size=columns.shape[1])
        every = np.ones(len(session.rows), dtype=bool)
        bad = [case for case in range(len(self.entered.ids)) if rng.random() < P_BAD]
        for rows, covariance in session.noise_of(every).covariances(values.errors, bad):
            for at, own in zip(rows, covariance, strict=True):
                reading[at] += np.linalg.cholesky(own) @ rng.normal(size=len(at))
        wrench = self.entered.wrench.copy()
        wrench.reshape(-1)[session.rows] = reading
        read = replace(self.entered, wrench=wrench)
        anew, mounted = session_of(self.model, read).errors.by_group, wrench.copy()
        for name, size in values.groups._asdict().items():
            mounted.reshape(-1)[session.rows] += anew[name] @ rng.normal(size=anew[name].shape[1]) * size
        return replace(read, wrench=mounted)


def _normalised(log_weight: Floats) -> Floats:
    out: Floats = np.exp(log_weight - logsumexp(log_weight))
    return out


def one_draw(priors: Priors, seed: int) -> dict[str, Any]:
    """Draw a session, diagnose it, and rank what is true of it within what is said."""
    rng = np.random.default_rng(seed)
    observations, truth, node, theta = priors.drawn(rng)
    began = time.perf_counter()
    found = diagnose(priors.model, observations)
    posterior = found.posterior
    seconds = time.perf_counter() - began
    log = {e: fit.log_posterior for e, fit in posterior.fits.items()}
    log |= {e: p.log_posterior for e, p in found.searched.promised.items()}
    total = float(logsumexp(list(log.values())))
    by_names: dict[tuple[str, ...], float] = {}
    for e, value in log.items():
        by_names[e.names] = by_names.get(e.names, 0.0) + float(np.exp(value - total))
    out: dict[str, Any] = {
        "seed": seed,
        "truth": list(truth.names),
        "verdict": found.verdict.kind,
        "names": list(found.verdict.names),
        "suspects": len(found.suspects),
        "probabilities": [[list(names), p] for names, p in by_names.items() if p >= 0.01],
        "seconds": seconds,
        "ranks": {},
    }
    fit = posterior.fits.get(truth)
    if fit is not None:
        out["ranks"] = ranks(fit, node, theta, rng)
    return out


def ranks(fit: Optimum, node: Node, theta: Floats, rng: Rng) -> dict[str, float]:
    """Rank (0 to 1) of what is true within the posterior of the explanation that is true."""
    weight = _normalised(np.array(list(fit.nodes.values())))
    nodes = list(fit.nodes)
    out = {}
    for name, axis in (AXES | ({"form": FORMS} if len(node) > FORMS else {})).items():
        at = np.array([n[axis] for n in nodes])
        out[name] = float(weight[at < node[axis]].sum() + rng.random() * weight[at == node[axis]].sum())
    table, scale = fit.session.model.parameters, fit.session.problem.scale
    kept = [k for k in np.argsort(-weight)[:12] if weight[k] >= 0.01]
    chosen: dict[str, int] = {
        kind: int(rng.choice(np.flatnonzero(fit.session.problem.free & table.of_kind(kind)))) for kind in KINDS
    }
    if fit.explanation.size:
        chosen["effect"] = fit.explanation.parameters[0]
    place: dict[str, list[float]] = {name: [] for name in chosen}
    for k in kept:
        mean, covariance, index = fit.parameter_posterior(nodes[k])
        for name, i in chosen.items():
            at = np.flatnonzero(index == i)
            if len(at):
                sd = float(np.sqrt(covariance[at[0], at[0]])) * scale[i]
                low = float(ndtr((table.initial[i] - mean[i]) / sd)) if table.one_sided[i] else 0.0
                place[name].append((float(ndtr((theta[i] - mean[i]) / sd)) - low) / max(1.0 - low, 1e-300))
    for name, values in place.items():
        if len(values) == len(kept):
            out[name] = float(np.average(values, weights=weight[kept]))
    return out


SAID = {
    "scatter": "scatter from case to case",
    "noise": "noise beside the measured one",
    "budget_multiple": "multiple of the budget",
    "anatomy_multiple": "multiple of the anatomy's spread",
    "budget": "one parameter of the budget",
    "anatomy": "one parameter of the anatomy",
    "smooth": "something smooth in joint torque",
    "form": "error of an effect's form",
    "effect": "size of the effect",
}


def report(rows: list[dict[str, Any]], session: str) -> list[str]:
    """Lines of the page."""
    lines = [
        "# Calibration on draws of the priors",
        "",
        f"`python -m benchmarks.calibration --draws {len(rows)} --session {session}`, "
        f"{dt.datetime.now(tz=dt.UTC).date()}, commit {commit()}; "
        f"{np.median([r['seconds'] for r in rows]):.1f} s a diagnosis (median).",
        "",
        "Rank of the true value within its posterior, where the true explanation was fitted: uniform if the inference",
        "is right.",
        "",
        "| of | draws | in fifths of the range | chance (Kolmogorov-Smirnov) |",
        "|---|---|---|---|",
    ]
    for name, words in SAID.items():
        values = [r["ranks"][name] for r in rows if name in r["ranks"]]
        if values:
            fifths = np.histogram(values, bins=5, range=(0.0, 1.0))[0]
            shares = " ".join(str(n) for n in fifths)
            lines.append(f"| {words} | {len(values)} | {shares} | {kstest(values, 'uniform').pvalue:.2g} |")
    lines += [
        "",
        "Probability of what acts, the evidence counted whole, and how often it came true:",
        "",
        "| stated | mean | came true | count |",
        "|---|---|---|---|",
    ]
    said = [(p, names == r["truth"]) for r in rows for names, p in r["probabilities"]]
    for low, high in pairwise(BINS):
        inside = [(p, true) for p, true in said if low < p <= high]
        if inside:
            mean, true = np.mean([p for p, _ in inside]), sum(t for _, t in inside)
            lines.append(f"| {low:g} to {high:g} | {mean:.3f} | {true / len(inside):.3f} | {true}/{len(inside)} |")
    missed = sum(1 for r in rows if r["truth"] and not r["ranks"])
    lines += [
        "",
        f"What acts was not fitted in {missed} of {sum(bool(r['truth']) for r in rows)} draws in which something acts: "
        "there it is too small to be seen.",
        "",
    ]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--session", default="DEV-01")
    parser.add_argument("--seed-from", default=None, metavar="COMMIT")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    options = parser.parse_args()
    base, priors, rows = base_seed(options.seed_from), Priors(options.session), []
    with options.out.with_suffix(".jsonl").open("w", encoding="utf-8") as kept:
        for k in range(options.draws):
            rows.append(one_draw(priors, base + k))
            kept.write(json.dumps(rows[-1]) + "\n")
            kept.flush()
    publish(options.out, report(rows, options.session))


if __name__ == "__main__":
    main()
