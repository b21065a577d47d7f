"""What rigs are known to do beyond the catalogue, as competitors of its effects: shunts, slips, creep and the like.

They are the ready-made effects of `data/effects` in a straightened form, about an optimum to which the base has been
refitted without them. That is enough to see one at work, and to say so under "none of the catalogue". To be found by
name and with a value, its file is given with `--effect`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from fingermodel.diagnosis.candidates import NOTHING_MISSING, Candidate
from fingermodel.diagnosis.evidence import (
    BUDGET_FACTORS,
    CLEAR,
    FORM_ERROR,
    IMPLAUSIBLE,
    LEFT_OVER,
    Known,
    budget_log_weight,
    estimates_of,
    scales,
)
from fingermodel.diagnosis.fitted import Fitted, far_off, objective_of
from fingermodel.diagnosis.linear import Linear, Posterior
from fingermodel.diagnosis.wildcard import FORM_ERRORS, Wildcard, form_of, rms_of
from fingermodel.model import tips_of
from fingermodel.problems import Problem
from fingermodel.refit import solve

Floats = NDArray[np.float64]

# Forms that are weighed with budget and form left open, and how often the base is refitted beside each.
WEIGHED, ROUNDS, EVALUATIONS = 3, 2, 12
# χ² per reading from which a base is bent.
BENT = 5.0
# Log evidence that a form must promise over the model without it, and of the best form, to be weighed.
WORTH, NEAR = 5.0, 30.0
# Prior widths, each half of a plausible range's half or of a one-sided range (see data/effects).
SHUNT, CREEP, LAG, SLIDE_MM, TURN_RAD, SLIP_MM = 0.1, 0.2, 0.05, 5.0, np.deg2rad(6.0), 3.0
# Time constants of creep, as shares of the session; angles [rad] at which EDC may slide, None for a sine.
TAUS = (0.005, 0.02, 0.08, 0.3)
STEPS = (None, *np.deg2rad([20.0, 40.0, 60.0]))
# χ² that parts two explanations for certain.
TOLD = 9.0
# Derivatives by difference: a small part of each prior width.
DIFFERENCE = 1e-3


@dataclass(frozen=True, eq=False)
class Form:
    """One form of one known thing.

    Attributes:
        name: of the ready-made effect.
        words: where or when, in plain words.
        columns: (cases, 6, k) what each of its k parameters changes in the readings [N, N mm] per prior width.
        share: of the prior of its effect.
    """

    name: str
    words: str
    columns: Floats
    share: float


@dataclass(frozen=True, eq=False)
class _Found:
    """A form, and how to make it again about another optimum.

    Attributes:
        form: as it is about the first.
        family: that makes it.
        place: among what that makes.
    """

    form: Form
    family: Callable[[Problem, Floats], Iterator[Form]]
    place: int

    def about(self, problem: Problem, optimum: Fitted) -> Form:
        """The same form about an optimum."""
        return next(islice(self.family(problem, optimum.theta), self.place, None))


def known_beyond(nothing: Fitted, candidates: tuple[Candidate, ...], had: Collection[str] = ()) -> tuple[Known, ...]:
    """Weigh what is known beyond the catalogue, most probable first; what the catalogue describes as well is left out.

    Args:
        nothing: the base model's optimum.
        candidates: that are searched.
        had: effects that the model has already.
    """
    problem = nothing.problem
    others = {*had, *(c.effect for c in candidates)}
    found = _found(problem, nothing.theta)
    gains = np.array([-np.inf if f.form.name in others else _gain(nothing.linear, problem, f.form) for f in found])
    # What a form promises about a base that was bent to do without it says little.
    near = np.inf if far_off(nothing, BENT) else NEAR
    promising = np.flatnonzero(gains > max(WORTH, gains.max(initial=-np.inf) - near))
    order = promising[np.argsort(-gains[promising])]
    # The best form of each effect first: another moment of a slip is no other explanation.
    best = list({found[i].form.name: found[i] for i in order[::-1]}.values())[::-1]
    if not best:
        return ()
    unbent = nothing
    if far_off(nothing, BENT):
        # What bends the base to do without the form hides it: begin from before anything was bent.
        begun = _refitted(problem, problem.centre, 1)
        unbent = begun if begun.sane else nothing
    weighed = (_weigh(nothing, unbent, one, candidates) for one in best[:WEIGHED])
    kept = [w for w in weighed if w is not None]
    return tuple(sorted(kept, key=lambda w: -w.log_evidence))


def forms(problem: Problem, theta: Floats) -> Iterator[Form]:
    """Every form of every known thing that this session could show.

    Args:
        problem: whose session it is.
        theta: (parameters,) about which they are straightened.
    """
    return (one.form for one in _found(problem, theta))


def _found(problem: Problem, theta: Floats) -> list[_Found]:
    families = (_shunts, _slides, _torques, _slips)
    return [_Found(form, family, place) for family in families for place, form in enumerate(family(problem, theta))]


def _shunts(problem: Problem, theta: Floats) -> Iterator[Form]:
    """A share of the force goes past the cell at one mount: of all, or what points one way."""
    inputs = problem.observations.inputs
    force = np.asarray(problem.model.predict(inputs, theta).reading)[:, :3]
    for place, at in (("tip", ~np.asarray(inputs.at_bone)), ("bone", np.asarray(inputs.at_bone))):
        if not at.any():
            continue
        lost = -SHUNT * force * at[:, None]
        yield Form("force_shunt", f"at the {place}", _padded(lost[:, :, None]), 0.25)
        # Symmetric in space, as anything elastic is that runs beside the cell.
        ways = []
        for i in range(3):
            for j in range(i + 1):
                one = np.zeros_like(force)
                one[:, i] += lost[:, j]
                if i != j:
                    one[:, j] += lost[:, i]
                ways.append(one if i == j else one / np.sqrt(2.0))
        yield Form("force_shunt", f"at the {place}, most in one direction", _padded(np.stack(ways, axis=2)), 0.25)


def _slides(problem: Problem, theta: Floats) -> Iterator[Form]:
    """EDC slides off the head of the metacarpal as the MCP flexes."""
    topology = problem.model.finger.topology
    if "MCP" not in topology.rotations:
        return
    flexion = np.asarray(problem.observations.inputs.posture)[:, topology.rotations.index("MCP")]
    moved = [
        _slope(problem, theta, {f"point.MCP.EDC.{end}.{axis}": -SLIDE_MM for end in ("proximal", "distal")})
        for axis in ("z", "y")
    ]
    columns = [c for c in moved if c is not None]
    if not columns or flexion.max(initial=0.0) < np.deg2rad(5.0):
        return
    for begin in STEPS:
        shape = np.sin(np.maximum(flexion, 0.0)) if begin is None else _step(flexion - begin, np.deg2rad(10.0))
        words = "as the MCP flexes" if begin is None else f"past {np.rad2deg(begin):.0f}° of MCP flexion"
        yield Form("edc_subluxation", words, np.stack([c * shape[:, None] for c in columns], axis=2), 1.0 / len(STEPS))


def _torques(problem: Problem, theta: Floats) -> Iterator[Form]:
    """Torque that decays from when a posture was set, and torque that lags behind the load."""
    observations = problem.observations
    inputs = observations.inputs
    torque = np.asarray(problem.model.predict(inputs, theta).torque)
    answer = torque_answer(problem)
    whole = np.einsum("nr,nri->ni", torque, answer)
    elapsed, setting = np.asarray(inputs.elapsed), np.asarray(inputs.setting)
    if elapsed.max(initial=0.0) > 0.0:
        begun = np.array([elapsed[setting == s].min() for s in setting])
        for tau in TAUS:
            decayed = 1.0 - np.exp(-(elapsed - begun) / tau)
            if np.ptp(decayed) > 0.05:
                lost = -CREEP * whole * decayed[:, None]
                yield Form("tissue_relaxation", "from when each posture was set", lost[:, :, None], 1.0 / len(TAUS))
    unloading = np.asarray(inputs.unloading) & ~np.asarray(inputs.is_check)
    if unloading.any() and not unloading.all():
        lagged = -LAG * whole * np.where(unloading, -1.0, 1.0)[:, None]
        yield Form("hysteresis", "with the sign of the last change of load", lagged[:, :, None], 1.0)


def _slips(problem: Problem, theta: Floats) -> Iterator[Form]:
    """The finger slips in its clamp once, between two cases: its joints have other angles from then on."""
    inputs = problem.observations.inputs
    elapsed, at_bone = np.asarray(inputs.elapsed), np.asarray(inputs.at_bone)
    turned = [_slope(problem, theta, {f"goniometer_bias.{j}": np.rad2deg(TURN_RAD)}) for j in ("MCP", "PIP", "DIP")]
    columns = [c for c in (*turned, _slope(problem, theta, {"tip_location.x": SLIP_MM})) if c is not None]
    times = np.unique(elapsed[~np.asarray(inputs.is_check)])
    if not columns or len(times) < 4:
        return
    moments = 0.5 * (times[1:] + times[:-1])
    for words, where in (("", np.ones(len(at_bone), dtype=bool)), (" at the tip", ~at_bone)):
        if where.all() and words:
            continue
        for moment in moments[1:-1]:
            after = ((elapsed > moment) & where)[:, None, None]
            said = f"{words.strip() + ' ' if words else ''}after {100.0 * moment:.0f} % of the session"
            yield Form("seating", said, np.stack(columns, axis=2) * after, 0.5 / len(moments))


def _slope(problem: Problem, theta: Floats, widths: dict[str, float]) -> Floats | None:
    """(cases, 6) change of every reading per prior width of some parameters moved together; None where one lacks."""
    table = problem.model.parameters
    if any(name not in table.index for name in widths):
        return None
    inputs = problem.observations.inputs
    moved = theta.copy()
    for name, width in widths.items():
        moved[table.index[name]] += DIFFERENCE * width
    now = np.asarray(problem.model.predict(inputs, theta).reading)
    out: Floats = (np.asarray(problem.model.predict(inputs, moved).reading) - now) / DIFFERENCE
    return out


def _padded(force: Floats) -> Floats:
    """Columns (cases, 3, k) of forces as those of readings: how a second path shares moments depends on its place."""
    return np.concatenate([force, np.zeros_like(force)], axis=1)


def _step(x: Floats, width: float) -> Floats:
    out: Floats = 0.5 * (1.0 + np.tanh(x / width))
    return out


def torque_answer(problem: Problem) -> Floats:
    """(n, rotations, 6) change of every reading per N mm of torque about a rotation."""
    model, inputs = problem.model, problem.observations.inputs
    topology = model.finger.topology
    tip = tips_of(topology, model.values, inputs)
    jacobian, to_base = np.asarray(tip.jacobian), np.asarray(tip.to_base)
    rows = list(topology.reactions)
    inverse = np.linalg.inv(np.swapaxes(jacobian[:, rows], 1, 2))
    wrench = np.zeros((len(jacobian), len(topology.rotations), 6))
    wrench[:, :, rows] = np.swapaxes(inverse, 1, 2)
    bone = np.zeros_like(wrench)
    bone[:, :, :3] = -np.einsum("nij,nrj->nri", to_base, wrench[:, :, :3])
    at_bone, check = np.asarray(inputs.at_bone), np.asarray(inputs.is_check)
    out: Floats = np.where(at_bone[:, None, None], bone, wrench) * ~check[:, None, None]
    return out


def _rows_of(problem: Problem, columns: Floats) -> Floats:
    out: Floats = problem.whitener @ columns.reshape(-1, columns.shape[2])[problem.rows]
    return out


def _gain(linear: Linear, problem: Problem, form: Form) -> float:
    """Log evidence that a form promises about an optimum, its share of the prior included."""
    columns = _rows_of(problem, form.columns)
    solved = linear.project(columns)
    hessian = np.eye(columns.shape[1]) + columns.T @ solved
    s = columns.T @ linear.unexplained
    return float(0.5 * s @ np.linalg.solve(hessian, s) - 0.5 * np.linalg.slogdet(hessian)[1] + np.log(form.share))


def _weigh(nothing: Fitted, unbent: Fitted, found: _Found, candidates: tuple[Candidate, ...]) -> Known | None:
    """Weigh one form beside a base that was refitted to what it leaves; None where it is no explanation of its own."""
    problem, now, strength = nothing.problem, unbent, 0.0
    own = found.form if unbent is nothing else found.about(problem, unbent)
    change = np.zeros((len(problem.observations.ids), 6))
    for _ in range(ROUNDS):
        size, strength = _sizes(now, _rows_of(problem, own.columns), change)
        change = own.columns @ size
        now = _refitted(problem.less(change), now.theta, EVALUATIONS)
        if not now.sane:
            return None
        own = found.about(problem, now)
    columns = _rows_of(problem, own.columns)
    own_rows = problem.whitener @ change.reshape(-1)[problem.rows]
    if _catalogue_has_it(now, own_rows, candidates):
        return None
    form = Wildcard.of(form_of(problem, change) * strength / (strength + CLEAR), FORM_ERRORS)
    linear = replace(
        now.linear,
        residual=now.residual + own_rows,
        h=np.concatenate([now.linear.h, columns], axis=1),
        x=np.concatenate([now.linear.x, np.zeros(columns.shape[1])]),
    )
    added = now.linear.h.shape[1] + np.arange(columns.shape[1])
    each: list[tuple[float, float]] = []
    for factor in BUDGET_FACTORS:
        free, scale = scales(now, factor)
        free, scale = np.concatenate([free, added]), np.concatenate([scale, np.ones(len(added))])
        value, error = form.log_marginal(form.profile(linear, free, scale), FORM_ERROR)
        each.append((value, estimates_of(linear, free, scale, form, error)[0]))
    total = np.array([value for value, _ in each]) + budget_log_weight() + now.of_bounds
    misfit = each[int(np.argmax(total))][1]
    readings = len(problem.rows)
    excess = max(nothing.objective - readings, 1.0)
    if chdtrc(readings, misfit) < IMPLAUSIBLE and misfit - readings > LEFT_OVER * excess:
        return None
    log_evidence = float(logsumexp(total) + np.log(own.share))
    return Known(own.name, own.words, log_evidence, rms_of(problem.observations, problem.rows, change), misfit)


def _sizes(now: Fitted, columns: Floats, change: Floats) -> tuple[Floats, float]:
    """Most probable sizes (k,) of a form, in prior widths, beside the base about an optimum that lacks a change.

    And how many standard deviations they lie from none.
    """
    problem, free = now.problem, now.inner
    beside = Posterior(
        now.residual + problem.whitener @ change.reshape(-1)[problem.rows],
        np.concatenate([now.linear.h[:, free], columns], axis=1),
        np.concatenate([now.x[free], np.zeros(columns.shape[1])]),
    )
    size, own = beside.values[len(free) :], beside.covariance[len(free) :, len(free) :]
    return size, float(np.sqrt(size @ np.linalg.solve(own, size)))


def _refitted(problem: Problem, start: Floats, evaluations: int) -> Fitted:
    """The base model's optimum."""
    solution = solve(problem, start, evaluations=evaluations)
    theta = problem.centre + problem.scale * solution.x
    return Fitted(NOTHING_MISSING, theta, solution.x, objective_of(solution), solution, problem)


def _catalogue_has_it(now: Fitted, change: Floats, candidates: tuple[Candidate, ...]) -> bool:
    """Whether an effect of the catalogue makes the same change as far as these readings can show.

    What the base absorbs counts for nothing, nor does what an error of that effect's form would.
    """
    linear = now.everything
    solved = linear.project(change[:, None])[:, 0]
    kept = float(change @ solved)
    told = max(TOLD, FORM_ERROR**2 * kept)
    full, _ = linear.information
    for candidate in candidates:
        for alternative in candidate.alternatives:
            index = list(alternative)
            a = full[np.ix_(index, index)]
            s = linear.h[:, index].T @ solved
            if float(s @ np.linalg.solve(a + 1e-6 * np.eye(len(index)) * max(np.trace(a), 1e-12), s)) > kept - told:
                return True
    return False
