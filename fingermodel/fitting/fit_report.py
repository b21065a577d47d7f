"""What a refit found: values with uncertainty, bounds, correlations, what the data say nothing about, what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from daq.vocabulary import did_you_mean
from fingermodel.fitting.problems import Problem, residual_at
from fingermodel.fitting.reading_errors import AS_STATED, OTHER_SCATTER, ReadingErrors, other_scatter
from fingermodel.model import Model

Floats = NDArray[np.float64]
# Of two parameters: they are listed from here on, and cannot be told apart from there on.
CORRELATED, ALIKE = 0.9, 0.95
# Relative scatter of the tensions, and noise beside the measured one [N], that are worth telling.
_TOLD_SCATTER, _TOLD_NOISE_N = 0.004, 0.002
Outcome = Literal["converged", "stalled", "too_many_evaluations", "not_finite"]


@dataclass(frozen=True)
class FittedParameter:
    """One parameter after a fit; `sd` is None where neither data nor prior determine it."""

    name: str
    unit: str
    kind: str
    initial: float
    value: float
    prior_sd: float | None
    sd: float | None
    at_bound: bool
    identified: bool

    @property
    def moved(self) -> float:
        """How far the value went, in standard deviations of its prior; 0 where that is flat."""
        return abs(self.value - self.initial) / self.prior_sd if self.prior_sd else 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The outcome of a refit as a value; `message` says what to do.

    `model` and `session` (its id) are those that were fitted; `theta` holds all parameters of that model. `optima` are
    objective and probability of each distinct optimum that was found, the values' own first. `weighted` says whether
    the objective counts in standard uncertainties (Eq 5 does not), `errors` what it counts with besides.
    """

    model: Model
    session: str
    method: str
    outcome: Outcome
    message: str
    objective: float
    objective_before: float
    evaluations: int
    seconds: float
    theta: Floats
    covariance: Floats
    free: NDArray[np.bool_]
    parameters: tuple[FittedParameter, ...]
    correlated: tuple[tuple[str, str, float], ...]
    residuals: int
    optima: tuple[tuple[float, float], ...] = ()
    weighted: bool = True
    errors: ReadingErrors = AS_STATED

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, free or not."""
        return dict(zip(self.model.parameters.names, self.theta.tolist(), strict=True))

    def __repr__(self) -> str:
        return f"<Fit ({self.method}), {self.outcome}: {int(self.free.sum())} parameters>"

    def parameter(self, name: str) -> FittedParameter:
        """Return one fitted parameter by name.

        Raises:
            InputError: none of that name was fitted.
        """
        found = next((p for p in self.parameters if p.name == name), None)
        if found is None:
            names = [p.name for p in self.parameters]
            raise InputError(f"no fitted parameter {name!r:.60}", "one of fit.parameters", did_you_mean(name, names))
        return found


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where one start of the solver ended.

    Attributes:
        theta: (parameters,).
        jacobian: (residuals, parameters) of the whitened residuals in scaled coordinates.
        objective: there.
        outcome: of the solver.
    """

    theta: Floats
    jacobian: Floats
    objective: float
    outcome: Outcome


def describe(
    problem: Problem,
    optima: Sequence[Optimum],
    method: str,
    before: float,
    evaluations: int,
    seconds: float,
    errors: ReadingErrors = AS_STATED,
) -> Fit:
    """Turn optima into a `Fit`: covariance, correlations, bounds, what the data say nothing about.

    The most probable optimum gives the values: what its height and its width make together (Laplace). Others widen the
    covariance: each counts by its probability, and its distance from the most probable one is uncertainty too.

    Args:
        problem: that was solved.
        optima: where the starts ended; at least one.
        method: `map` or `slsqp`.
        before: objective before the fit.
        evaluations: of the objective, all starts together.
        seconds: of the solution.
        errors: of the readings that the problem counts with.
    """
    table = problem.model.parameters
    found = _distinct(problem, optima)
    noise = 1.0 if problem.weighted else _noise_variance(problem, found[0])
    laplace = [_laplace(problem, optimum) for optimum in found]
    log_weight = np.array(
        [-0.5 * o.objective / noise - 0.5 * part.log_det for o, part in zip(found, laplace, strict=True)]
    )
    # Where nothing says how much readings count, the least objective is all there is to go by.
    order = np.argsort(-log_weight, kind="stable") if problem.weighted else np.arange(len(found))
    weight = np.exp(log_weight[order] - log_weight.max())
    weight /= weight.sum()
    ranked, local = [found[k] for k in order], [laplace[k] for k in order]
    best, theta = ranked[0], ranked[0].theta
    at_bound = held_at_bound(problem, theta)
    covariance = np.zeros((len(table), len(table)))
    for share, optimum, part in zip(weight, ranked, local, strict=True):
        away = optimum.theta - theta
        covariance += share * (part.covariance * noise + np.outer(away, away))
    unknown = local[0].unknown

    sd = np.sqrt(np.diag(covariance))
    # Whether data speak is asked where the values stand: rivals elsewhere disagree about what they say.
    local_sd = np.sqrt(np.diag(local[0].covariance) * noise)
    parameters = []
    for i, p in enumerate(table):
        if not problem.free[i]:
            continue
        width = problem.sd[i] if np.isfinite(problem.sd[i]) else (problem.upper[i] - problem.lower[i]) / np.sqrt(12.0)
        # Data that shrink the prior's variance by less than a hundredth have said nothing.
        informed = not unknown[i] and (at_bound[i] or local_sd[i] ** 2 < 0.99 * width**2)
        prior_sd = float(problem.sd[i]) if np.isfinite(problem.sd[i]) else None
        parameters.append(
            FittedParameter(
                name=p.name,
                unit=p.unit,
                kind=p.kind,
                initial=p.initial,
                value=float(theta[i]),
                prior_sd=prior_sd,
                sd=None if unknown[i] or at_bound[i] else float(sd[i]),
                at_bound=bool(at_bound[i]),
                identified=bool(informed),
            )
        )
    fit = Fit(
        model=problem.model,
        session=problem.observations.session,
        method=method,
        outcome=best.outcome,
        message="",
        objective=best.objective,
        objective_before=before,
        evaluations=evaluations,
        seconds=seconds,
        theta=theta,
        covariance=covariance,
        free=problem.free,
        parameters=tuple(parameters),
        correlated=_correlated(table.names, covariance),
        residuals=len(problem.rows),
        optima=tuple((o.objective, float(share)) for o, share in zip(ranked, weight, strict=True)),
        weighted=problem.weighted,
        errors=errors,
    )
    return _with_message(fit, table.fixed_elsewhere)


@dataclass(frozen=True)
class _Local:
    covariance: Floats
    log_det: float
    unknown: NDArray[np.bool_]


def _laplace(problem: Problem, optimum: Optimum) -> _Local:
    """Covariance at an optimum for unit noise; parameters at a bound are held there."""
    moving = problem.free & ~held_at_bound(problem, optimum.theta)
    scale, size = problem.scale, len(problem.scale)
    jacobian = optimum.jacobian[:, moving]
    hessian = jacobian.T @ jacobian + np.diag(problem.weight[moving])
    values, vectors = np.linalg.eigh(hessian) if moving.any() else (np.ones(0), np.zeros((0, 0)))
    determined = values > max(float(values.max(initial=0.0)), 1.0) * 1e-13
    inverse = (vectors / np.where(determined, values, np.inf)) @ vectors.T
    covariance = np.zeros((size, size))
    covariance[np.ix_(moving, moving)] = inverse * np.outer(scale[moving], scale[moving])
    unknown = np.zeros(size, dtype=bool)
    unknown[np.flatnonzero(moving)[(vectors[:, ~determined] ** 2).sum(axis=1) > 1e-6]] = True
    return _Local(covariance, float(np.log(values[determined]).sum()), unknown)


def _distinct(problem: Problem, optima: Sequence[Optimum]) -> list[Optimum]:
    """Converged optima that are different places, best first; the best of all if none converged."""
    ranked = sorted(optima, key=lambda o: o.objective if np.isfinite(o.objective) else np.inf)
    kept: list[Optimum] = []
    for optimum in [o for o in ranked if o.outcome == "converged"] or ranked[:1]:
        places = [
            np.abs((optimum.theta - other.theta) / problem.scale)[problem.free].max(initial=0.0) for other in kept
        ]
        if all(distance > 0.05 for distance in places):
            kept.append(optimum)
    return kept


def held_at_bound(problem: Problem, theta: Floats) -> NDArray[np.bool_]:
    """Which free parameters (parameters,) stand at a bound."""
    near = 1e-6 * problem.scale
    held: NDArray[np.bool_] = problem.free & ((theta <= problem.lower + near) | (theta >= problem.upper - near))
    return held


def _noise_variance(problem: Problem, optimum: Optimum) -> float:
    """Eq 5 states no noise: take it from the residual, with the parameters that the data truly spent."""
    moving = problem.free & ~held_at_bound(problem, optimum.theta)
    residual = residual_at(problem, optimum.theta)
    spent = _spent(optimum.jacobian, problem.weight, moving)
    return float(residual @ residual) / max(len(residual) - spent, 1.0)


def _spent(jacobian: Floats, weight: Floats, moving: NDArray[np.bool_]) -> float:
    """Effective number of parameters: trace of the hat matrix."""
    if not moving.any():
        return 0.0
    data = jacobian[:, moving].T @ jacobian[:, moving]
    return float(np.trace(np.linalg.pinv(data + np.diag(weight[moving])) @ data))


def _correlated(names: tuple[str, ...], covariance: Floats) -> tuple[tuple[str, str, float], ...]:
    sd = np.sqrt(np.diag(covariance))
    safe = np.where(sd > 0, sd, 1.0)
    correlation = np.triu(covariance / np.outer(safe, safe), 1)
    pairs = np.argwhere(np.abs(correlation) > CORRELATED)
    found = [(names[i], names[j], float(correlation[i, j])) for i, j in pairs]
    return tuple(sorted(found, key=lambda pair: -abs(pair[2])))


def _with_message(fit: Fit, fixed: Sequence[str]) -> Fit:
    parts = {
        "converged": "Converged.",
        "stalled": "Stopped where rounding hides further progress; the values hold, their uncertainties may not.",
        "too_many_evaluations": "Not converged: do not use these values. Check the session, or start elsewhere.",
        "not_finite": "The model gives no finite forces here: check postures and masses.",
    }
    text = [parts[fit.outcome]]
    if misfit_is_excessive(fit):
        text.append(
            f"The misfit is {fit.objective:.0f} where noise and priors leave about {fit.residuals}: the model lacks "
            "something, or the stated uncertainties are too small."
        )
    text += [*fixed, *_said_of(fit.errors)]
    seen = [p for p in fit.parameters if p.at_bound]
    null = [p.name for p in seen if p.kind == "effect" and p.value == p.initial]
    bound = [p.name for p in seen if p.name not in null]
    if null:
        text.append(f"At {'its' if len(null) == 1 else 'their'} null: {_few(null)}; nothing of it is seen.")
    if bound:
        text.append(
            f"{len(bound)} at a bound ({_few(bound)}): the data want more than is plausible; look for a missing effect."
        )
    anatomy = [p for p in fit.parameters if p.kind != "budget"]
    blind = [p.name for p in anatomy if not p.identified]
    if blind:
        text.append(
            f"The data say nothing about {len(blind)} of {len(anatomy)} parameters of the finger ({_few(blind)}): "
            "they keep their prior; load those tendons, or read more components, to know them."
        )
    rivals = [share for _, share in fit.optima[1:] if share > 0.01]
    if rivals:
        text.append(
            f"Elsewhere {len(rivals)} {'optima fit' if len(rivals) > 1 else 'optimum fits'} nearly as well "
            f"(probability {sum(rivals):.2f}); "
            "the stated uncertainties cover them."
        )
    if alike := [pair for pair in fit.correlated if abs(pair[2]) >= ALIKE]:
        a, b, r = alike[0]
        text.append(f"{len(alike)} pairs cannot be told apart (|r| >= {ALIKE:g}), first {a} and {b} ({r:+.2f}).")
    return replace(fit, message=" ".join(text))


def _said_of(errors: ReadingErrors) -> list[str]:
    """What the uncertainties count besides noise of plateau and tare, and which cases stand apart."""
    out, extra = [], []
    if errors.scatter >= _TOLD_SCATTER:
        extra.append(f"{100.0 * errors.scatter:.1f} % of each tension from case to case")
    extra += other_scatter({name: getattr(errors, name) for name in OTHER_SCATTER})
    if (errors.extra_noise_N or 0.0) >= _TOLD_NOISE_N:
        extra.append(f"{1000.0 * (errors.extra_noise_N or 0.0):.0f} mN of each reading")
    if extra:
        out.append(f"The readings scatter by {', by '.join(extra)}; the uncertainties count that.")
    if errors.not_counted:
        out.append(
            f"Not counted: {_few(list(errors.not_counted))}, far from what all others say; diagnose says what may "
            "have been done there."
        )
    return out


def misfit_is_excessive(fit: Fit) -> bool:
    """Whether the optimum fits worse than noise and priors allow (one chance in a thousand).

    The penalised optimum itself is chi-square with as many degrees of freedom as there are readings. Eq 5 states no
    noise, so there is nothing to hold its misfit against.
    """
    from scipy.special import chdtrc

    return fit.weighted and bool(chdtrc(fit.residuals, fit.objective) < 1e-3)


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
