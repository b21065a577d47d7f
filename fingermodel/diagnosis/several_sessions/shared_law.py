"""A law that nobody listed and that several sessions share: found as a smooth curve, and likened to small laws.

Beside all that acts in each session by itself (anatomy, budget, noise, scatter, something smooth of its own) a curve of
each tendon and joint is the same in all of them: an error of moment arms, tensions or forces, smooth over postures.
Each session says of the curve's weights what its readings do; the curve's evidence is that of the sum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.gaussian import add_one
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.discrepancy import smooth_over
from fingermodel.diagnosis.settings import SEED, SHARED_SIZES

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Stage = Literal["arms", "tension", "force"]
UNITS: dict[Stage, str] = {"arms": "mm", "tension": "1", "force": "N"}
# Smallest variance of a posture's feature that is kept, of a largest of 1 a posture.
_LEAST_FEATURE = 1e-3


@dataclass(frozen=True, eq=False)
class Said:
    """What one session says of a curve's weights at one node of its hyperparameters.

    Attributes:
        log_joint: of the node, without the curve.
        information: (m, m) of the weights.
        score: (m,).
    """

    log_joint: float
    information: Floats
    score: Floats

    def turned(self, order: Ints, sign: Floats) -> Said:
        """The same of other weights: in another order, and of another sign."""
        information = self.information[np.ix_(order, order)] * sign[:, None] * sign
        return Said(self.log_joint, information, self.score[order] * sign)


def gain(said: Sequence[Said], size: float, kept: Ints | None = None) -> float:
    """Log evidence that weights of a size add to what some sessions say, all other things integrated out.

    Args:
        said: by each session.
        size: of the weights, in their unit.
        kept: indices of the weights that may act; by default all.
    """
    if not said or size == 0.0:
        return 0.0
    information = np.sum([s.information for s in said], axis=0) * size**2
    score = np.sum([s.score for s in said], axis=0) * size
    if kept is not None:
        information, score = information[np.ix_(kept, kept)], score[kept]
    add_one(information)
    root = np.linalg.cholesky(information)
    step = solve_triangular(root, score, lower=True, check_finite=False)
    return float(0.5 * step @ step - np.log(np.diag(root)).sum())


@dataclass(frozen=True, eq=False)
class Curve:
    """Columns by which a shared curve changes a session's readings.

    Attributes:
        stage: at which it acts.
        parts: (tendon, joint or mount and axis) of each group of weights.
        columns: (fitted readings, weights) [N, N mm] per unit; groups one after another, features within.
        changes: (cases, 6, weights) the same of all readings.
    """

    stage: Stage
    parts: tuple[tuple[str, str], ...]
    columns: Floats
    changes: Floats


class Curves:
    """The curves of several sessions, over the postures of all of them.

    Args:
        fits: of each session, with whatever is known to act there by itself.
    """

    def __init__(self, fits: Sequence[Optimum]) -> None:
        self._fits = fits
        angles = np.concatenate([np.array(list(f.session.observations.posture_angles.values())) for f in fits])
        self.postures: Floats = np.unique(angles.round(6), axis=0)
        root = smooth_over(self.postures)
        strong = (root**2).sum(axis=0) > _LEAST_FEATURE
        self.root: Floats = root[:, strong]

    def at(self, fit: Optimum) -> Floats:
        """(cases, features) of each case's posture; 0 for a check."""
        observations = fit.session.observations
        angles = np.asarray(observations.inputs.posture).round(6)
        place = np.argmin(((angles[:, None, :] - self.postures) ** 2).sum(axis=2), axis=1)
        loaded = np.array([bool(p) for p in observations.postures])
        return np.where(loaded[:, None], self.root[place], 0.0)

    def of(self, fit: Optimum, stage: Stage) -> Curve:
        """The columns of one session."""
        session, features = fit.session, self.at(fit)
        parts, changes = [], []
        for part, change in _unit_changes(fit, stage):
            parts.append(part)
            changes.append(change[:, :, None] * features[:, None, :])
        whole = np.concatenate(changes, axis=2)
        rows = session.rows[session.fitted]
        return Curve(stage, tuple(parts), whole.reshape(-1, whole.shape[2])[rows], whole)


def _unit_changes(fit: Optimum, stage: Stage) -> Iterator[tuple[tuple[str, str], Floats]]:
    """Change (cases, 6) of all readings per unit of each tendon's error: 1 mm of an arm, all of a tension, 1 N."""
    session = fit.session
    topology, inputs = session.model.finger.topology, session.observations.inputs
    tension = np.asarray(inputs.tension)
    share = tension / np.maximum(tension.max(axis=0), 1e-9)
    if stage == "arms":
        answer = session.torque_answer
        for k, muscle in enumerate(topology.muscles):
            for joint in topology.joints:
                if joint.flexion >= 0:
                    row = topology.rotations.index(joint.rotations[joint.flexion])
                    yield (muscle, joint.name), answer[:, row] * tension[:, [k]]
    elif stage == "tension":
        by_tension = session.by_tension(fit.theta)
        for k, muscle in enumerate(topology.muscles):
            yield (muscle, ""), by_tension[:, :, k]
    else:
        at_bone, loaded = np.asarray(inputs.at_bone), np.array([bool(p) for p in session.observations.postures])
        axes = "xy" if session.plane == "sagittal" else "xyz"
        for k, muscle in enumerate(topology.muscles):
            for place, here in (("tip", ~at_bone & loaded), ("bone", at_bone)):
                for axis, name in enumerate(axes):
                    change = np.zeros((len(tension), 6))
                    change[:, axis] = share[:, k] * here
                    yield (muscle, f"{place} {name}"), change


class Sharing:
    """What sessions say of one curve at their nodes, each asked once.

    Args:
        fits: of each session.
        columns: (fitted readings, weights) of each session.
    """

    def __init__(self, fits: Sequence[Optimum], columns: Sequence[Floats]) -> None:
        self._fits, self._columns = fits, columns
        self._known: list[dict[Node, Said]] = [{} for _ in fits]

    def said(self, k: int, node: Node) -> Said:
        """What a session says at a node."""
        known = self._known[k]
        if node not in known:
            fit = self._fits[k]
            information, score = fit.information(self._columns[k], node)
            known[node] = Said(fit.log_joint(node), information, score)
        return known[node]

    def all_said(self, nodes: Sequence[Node]) -> list[Said]:
        """What all sessions say, each at its node."""
        return [self.said(k, node) for k, node in enumerate(nodes)]

    def value(self, nodes: Sequence[Node], size: float) -> float:
        """Log of prior times likelihood of all sessions together."""
        said = self.all_said(nodes)
        return sum(s.log_joint for s in said) + gain(said, size)

    def climbed(self, nodes: Sequence[Node], size: float) -> list[Node]:
        """The sessions' nodes from which no step along an axis of one of them leads higher."""
        best, value, moved = list(nodes), self.value(nodes, size), True
        while moved:
            moved = False
            for k, fit in enumerate(self._fits):
                for node in fit.hyper.neighbours(best[k]):
                    trial = [*best[:k], node, *best[k + 1 :]]
                    reached = self.value(trial, size)
                    if reached > value:
                        best, value, moved = trial, reached, True
        return best

    def log_evidence(self, nodes: Sequence[Node], size: float) -> float:
        """With each session's hyperparameters summed about its node, the others where they are."""
        value, more = self.value(nodes, size), 0.0
        for k, fit in enumerate(self._fits):
            around = [node for node in fit.hyper.neighbours(nodes[k]) if node in self._known[k]]
            each = [self.value([*nodes[:k], node, *nodes[k + 1 :]], size) for node in around]
            more += float(logsumexp([value, *each])) - value
        return value + more


@dataclass(frozen=True, eq=False)
class SharedCurve:
    """A curve that sessions share, at one stage.

    Attributes:
        stage: moment arms [mm], tensions [relative] or forces [N].
        parts: tendon, and joint or mount and axis, of each of its groups.
        size: likeliest amplitude, in the stage's unit.
        log_evidence_over_own: that it is shared, over each session's having its own.
        left_out_gain: (sessions,) log density that it adds to each session, learned from the others.
        log_evidence_lost: (parts,) without each group.
        postures: (postures, rotations) [rad], and
        rotations: their names.
        mean: (parts, postures), in the stage's unit.
        sd: (parts, postures).
        own: (sessions, parts, postures) by each session alone.
        nodes: of the sessions.
    """

    stage: Stage
    parts: tuple[tuple[str, str], ...]
    size: float
    log_evidence_over_own: float
    left_out_gain: Floats
    log_evidence_lost: Floats
    postures: Floats
    rotations: tuple[str, ...]
    mean: Floats
    sd: Floats
    own: Floats
    nodes: tuple[Node, ...]


@dataclass(eq=False)
class StageSearch:
    """The curve of one stage: sizes tried, and what each leads to."""

    fits: Sequence[Optimum]
    curves: Curves
    stage: Stage
    paths: dict[float, tuple[Node, ...]] = field(default_factory=dict)

    @cached_property
    def columns(self) -> list[Curve]:
        """Of each session."""
        return [self.curves.of(fit, self.stage) for fit in self.fits]

    @cached_property
    def sharing(self) -> Sharing:
        """What the sessions say."""
        return Sharing(self.fits, [c.columns for c in self.columns])

    def run(self) -> SharedCurve:
        """Climb at every size, and describe the best."""
        nodes: list[Node] = [fit.best for fit in self.fits]
        sizes = SHARED_SIZES[self.stage]
        values = {}
        for size in (0.0, *sizes):
            nodes = self.sharing.climbed(nodes, size)
            self.paths[size] = tuple(nodes)
            values[size] = self.sharing.log_evidence(nodes, size)
        together = float(logsumexp([values[s] for s in sizes]) - np.log(len(sizes)))
        best = max(sizes, key=lambda s: values[s])
        return self._described(best, together - values[0.0])

    def _described(self, size: float, over_own: float) -> SharedCurve:
        said, parts = self.sharing.all_said(self.paths[size]), self.columns[0].parts
        count, features = len(parts), self.curves.root.shape[1]
        whole = gain(said, size)
        left_out = np.array([whole - gain([*said[:k], *said[k + 1 :]], size) for k in range(len(said))])
        every = np.arange(count * features).reshape(count, features)
        lost = np.array([whole - gain(said, size, np.delete(every, p, axis=0).reshape(-1)) for p in range(count)])
        mean, sd = self._values(said, size)
        own = np.array([self._values([one], size)[0] for one in said])
        rotations = tuple(self.fits[0].session.model.finger.topology.rotations)
        return SharedCurve(
            self.stage,
            parts,
            size,
            over_own,
            left_out,
            lost,
            self.curves.postures,
            rotations,
            mean,
            sd,
            own,
            self.paths[size],
        )

    def _values(self, said: Sequence[Said], size: float) -> tuple[Floats, Floats]:
        """Mean and standard deviation (parts, postures) of the curve."""
        information = np.sum([s.information for s in said], axis=0) * size**2
        add_one(information)
        covariance = np.linalg.inv(information)
        weights = covariance @ np.sum([s.score for s in said], axis=0) * size
        root, features = self.curves.root, self.curves.root.shape[1]
        mean = size * weights.reshape(-1, features) @ root.T
        blocks = covariance.reshape(-1, features, len(covariance) // features, features)
        own = np.array([blocks[k, :, k] for k in range(len(blocks))])
        variance = size**2 * np.einsum("pf,kfg,pg->kp", root, own, root)
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def best_value(self, turned: Sequence[tuple[Ints, Floats]]) -> float:
        """What sharing gains at most over not sharing, after each session's weights have been turned."""
        options = [list(dict.fromkeys(path[k] for path in self.paths.values())) for k in range(len(self.fits))]
        said = [[self.sharing.said(k, n).turned(*turned[k]) for n in nodes] for k, nodes in enumerate(options)]
        nothing = sum(max(s.log_joint for s in mine) for mine in said)
        out = 0.0
        for size, path in self.paths.items():
            at = [options[k].index(node) for k, node in enumerate(path)]
            value = _best_of(said, at, size) - nothing
            out = max(out, value)
        return out

    @property
    def groups(self) -> tuple[int, int, int]:
        """Tendons, groups of each, and features of each group; weights are counted in this order."""
        muscles = len(dict.fromkeys(m for m, _ in self.columns[0].parts))
        return muscles, len(self.columns[0].parts) // muscles, self.curves.root.shape[1]


def _best_of(said: Sequence[Sequence[Said]], at: list[int], size: float) -> float:
    """Value at the best of each session's options, changed one after another."""

    def value(chosen: Sequence[int]) -> float:
        mine = [options[i] for options, i in zip(said, chosen, strict=True)]
        return sum(s.log_joint for s in mine) + gain(mine, size)

    best, reached, moved = list(at), value(at), True
    while moved:
        moved = False
        for k, options in enumerate(said):
            for i in range(len(options)):
                trial = [*best[:k], i, *best[k + 1 :]]
                if i != best[k] and (now := value(trial)) > reached:
                    best, reached, moved = trial, now, True
    return reached


def permuted(
    searches: Sequence[StageSearch], count: int, tell: Callable[[float], None] | None = None
) -> tuple[float, Floats]:
    """What sharing gains at most, as the sessions are and with tendons and signs of each shuffled.

    Sessions that share nothing gain as much in any order.

    Args:
        searches: of the stages, that have run.
        count: of shuffles.
        tell: is told the share done.

    Returns:
        The gain as the sessions are, and (count,) after shuffles; always the same ones.
    """
    rng = np.random.default_rng(SEED)

    def best(order_of: Sequence[tuple[Ints, Floats]]) -> float:
        found = []
        for search in searches:
            muscles, groups, features = search.groups
            turned = []
            for order, sign in order_of:
                index = np.arange(muscles * groups * features).reshape(muscles, groups * features)[order].reshape(-1)
                turned.append((index, np.repeat(sign, groups * features)))
            found.append(search.best_value(turned))
        return max(found)

    muscles = searches[0].groups[0]
    plain = (np.arange(muscles), np.ones(muscles))
    sessions = len(searches[0].fits)
    observed = best([plain] * sessions)
    out = np.empty(count)
    for k in range(count):
        others = [(rng.permutation(muscles), rng.choice([-1.0, 1.0], muscles)) for _ in range(sessions - 1)]
        out[k] = best([plain, *others])
        if tell is not None:
            tell((k + 1) / count)
    return observed, out


def p_value(observed: float, shuffled: Floats) -> float:
    """Share of the shuffles that gain as much, the sessions as they are counted as one."""
    return float((1 + np.sum(shuffled >= observed)) / (1 + len(shuffled)))
