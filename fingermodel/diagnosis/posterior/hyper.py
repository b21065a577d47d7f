"""The few hyperparameters and their priors on a grid, and the nodes that matter.

These are the most probable one, and those around it that are hardly less probable.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats
from fingermodel.diagnosis import settings
from fingermodel.diagnosis.axis import Axis
from fingermodel.diagnosis.session_model.case_noise import CaseErrors
from fingermodel.diagnosis.session_model.group_errors import GroupErrors
from fingermodel.diagnosis.session_model.session import Session

# Indices on the axes: scatter of tensions, noise, the other kinds of scatter (see `CaseErrors`), budget, anatomy,
# errors by group of cases (see `GroupErrors`), something smooth of each family (see `Session.smooth`), and what carries
# it; then one error of form for each member that has a form.
Node = tuple[int, ...]
SCATTER, NOISE, COMPONENT, DIRECTION, ANGLE, BUDGET, ANATOMY, GROUP = range(8)
GROUPS = GroupErrors._fields
SMOOTH = GROUP + len(GROUPS)
# Scatter beside that of the tensions, and errors by group, by their names.
OTHER_SCATTER = {"component": COMPONENT, "direction": DIRECTION, "angle_rad": ANGLE}
OTHER_SCATTER |= {name: GROUP + k for k, name in enumerate(GROUPS)}
# Those of `CaseErrors`.
OF_CASES = slice(SCATTER, BUDGET)
# Those of `GroupErrors`.
OF_GROUPS = slice(GROUP, SMOOTH)
FAMILIES = ("torque", "tension", "loaded", "constant")
CARRIER = SMOOTH + len(FAMILIES)
FORMS = CARRIER + 1
# Blocks of weights that act at every node (see `Linearised`); those of errors by group have the names of `GROUPS`.
ACTING = ("held", "budget", "anatomy")
# Scatter of a usual bench, relative; and the factor within which a stated one is believed.
_USUAL_SCATTER, STATED_FACTOR = 0.01, 1.5
_SIZES = (settings.TENSION, settings.EXTRA_NOISE_N, settings.READING, settings.READING, settings.ANGLE_RAD)
# Most nodes of one explanation; those beyond count as if the axes were independent of each other.
MOST_NODES = 100
# A node that was kept means the same only where this is the same: the axes in their order, and their values.
_GRIDS = [axis.value for axis in vars(settings).values() if isinstance(axis, Axis)]
_AXES = (CaseErrors._fields, ACTING[1:], GROUPS, FAMILIES, _GRIDS)
GRIDS = hashlib.sha256(repr(_AXES).encode()).hexdigest()[:12]


class Values(NamedTuple):
    """Of a node: sizes of noise by case, multiples, errors by group, errors of form."""

    errors: CaseErrors
    budget: float
    anatomy: float
    groups: GroupErrors
    forms: Floats


@dataclass(frozen=True, eq=False)
class Hyperparameters:
    """The axes of one session."""

    # Scatter and noise (see `CaseErrors`), multiples of the budget and of the anatomy, errors by group of cases (see
    # `GroupErrors`), amplitude of each family of something smooth [N], and what carries it: the index among the
    # carriers.
    axes: tuple[Axis, ...]
    form: Axis  # error of an effect's form
    carriers: tuple[str, ...]  # of something smooth (see `Session.carriers`)
    tendons: int  # how many of them are tendons
    postures: int  # how many of them, the last, are postures
    noise_assumed: bool  # whether the readings' noise is; its axis is then a multiple
    _smooth: dict[Node, dict[str, float]] = field(default_factory=dict, init=False, repr=False)
    _widths: dict[Node, dict[str, float]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, session: Session) -> Hyperparameters:
        """Priors as the session states them."""
        stated, assumed = session.stated_scatter, session.observations.noise_assumed
        scatter, noise, *others = _SIZES
        if stated > 0.0:
            scatter = Axis.log_normal(scatter.values, stated, STATED_FACTOR)
        if assumed:
            noise = settings.ASSUMED_NOISE
        multiple, smooth = settings.MULTIPLE, settings.SMOOTH_N.with_atom(settings.P_UNUSUAL / len(FAMILIES))
        carriers = session.changes.carriers
        of_one = settings.P_UNUSUAL / (len(carriers) - 1)
        of_each = np.log([1.0 - settings.P_UNUSUAL, *[of_one] * (len(carriers) - 1)])
        carrier = Axis(np.arange(float(len(carriers))), of_each)
        of_groups = [
            settings.OF_GROUP.times(size) if size * session.errors.by_group[name].any() else Axis.none()
            for name, size in GroupErrors.usual(session.model.budget)._asdict().items()
        ]
        axes = (scatter, noise, *others, multiple, multiple, *of_groups, *[smooth] * len(FAMILIES), carrier)
        tendons = len(set(carriers) & set(session.model.finger.topology.muscles))
        postures = len(carriers) - 1 - tendons - len(session.model.finger.topology.rotations)
        return cls(axes, settings.FORM, carriers, tendons, postures, assumed)

    def start(self, forms: int) -> Node:
        """The most probable node before any reading."""
        return (*(axis.mode for axis in self.axes), *[self.form.mode] * forms)

    @property
    def usual(self) -> Node:
        """The same with the scatter of a usual bench: where a search begins."""
        scatter = int(np.argmin(np.abs(self.axes[SCATTER].values - _USUAL_SCATTER)))
        return (scatter, *self.start(0)[1:])

    @property
    def lenient(self) -> Node:
        """Most scatter, the largest budget and anatomy, and a moderate amplitude of every family of what is smooth."""
        most = [len(axis.values) - 1 for axis in self.axes]
        most[NOISE:BUDGET] = self.start(0)[NOISE:BUDGET]
        return self.with_smooth((*most[:SMOOTH], *[0] * (FORMS - SMOOTH)))

    def with_smooth(self, node: Node) -> Node:
        """The same node with the stated noise, and a moderate amplitude of every family of something smooth."""
        return self._with_amplitudes(node, [len(self.axes[SMOOTH].values) // 2] * len(FAMILIES))

    def with_one_family(self, node: Node) -> list[Node]:
        """The same node with the stated noise, and a small or a large amplitude of one family of something smooth."""
        count = len(self.axes[SMOOTH].values)
        sizes = count // 3, 2 * count // 3
        return [self._with_amplitudes(node, _of_one_family(own, size)) for own in FAMILIES for size in sizes]

    def _with_amplitudes(self, node: Node, smooth: Sequence[int]) -> Node:
        return (node[SCATTER], self.axes[NOISE].mode, *node[NOISE + 1 : SMOOTH], *smooth, 0, *node[FORMS:])

    def with_carriers(self, node: Node) -> list[Node]:
        """The same node with each other carrier of what is smooth.

        Where nothing is, with a moderate torque of each, or a moderate error of each tension.
        """
        middle, nodes = len(self.axes[SMOOTH].values) // 2, list[Node]()
        for c in range(1, len(self.carriers)):
            families = ("torque", "tension") if c <= self.tendons or self._of_posture(c) else ("torque",)
            begun = [node[SMOOTH:CARRIER]] if self._carried(node) else [_of_one_family(f, middle) for f in families]
            nodes += [(*node[:SMOOTH], *smooth, c, *node[FORMS:]) for smooth in begun]
        return [other for other in nodes if other != node]

    def carrier(self, node: Node) -> str:
        """Tendon, rotation or posture that has alone what is smooth; "" where all of them may, or nothing is."""
        return self.carriers[node[CARRIER]]

    def _of_posture(self, carrier: int) -> bool:
        return carrier >= len(self.carriers) - self.postures

    def near(self, a: Node, b: Node) -> bool:
        """Whether two nodes are no more than a step apart on any axis, with the same carrier."""
        return a[CARRIER] == b[CARRIER] and max(abs(i - j) for i, j in zip(a, b, strict=True)) <= 1

    def _carried(self, node: Node) -> bool:
        """Whether anything is smooth that a carrier may have alone."""
        return any(node[SMOOTH : CARRIER - 1])

    def plainly(self, node: Node) -> Node:
        """The same node; where nothing is smooth, nothing carries it."""
        return node if self._carried(node) else self.of_all(node)

    def of_all(self, node: Node) -> Node:
        """The same node with what is smooth of everything."""
        return (*node[:CARRIER], 0, *node[FORMS:])

    def log_prior(self, node: Node) -> float:
        """Of a node."""
        weights = [axis.weight[i] for axis, i in zip(self._axes_of(node), node, strict=True)]
        if not self._carried(node):
            weights[CARRIER] = 0.0
        return sum(weights)

    def _axes_of(self, node: Node) -> tuple[Axis, ...]:
        return (*self.axes, *[self.form] * (len(node) - FORMS))

    def log_prior_of_smooth(self, node: Node) -> float:
        """Of what is smooth at a node, whatever its amplitudes: which families are, and what carries them."""
        none = self.axes[SMOOTH].weight[0]
        some = float(np.log(-np.expm1(none)))
        there = sum(some if i else none for i in node[SMOOTH:CARRIER])
        return there + (self.axes[CARRIER].weight[node[CARRIER]] if self._carried(node) else 0.0)

    def values(self, node: Node) -> Values:
        """What a node stands for."""
        at = [axis.value[i] for axis, i in zip(self.axes, node, strict=False)]
        forms = self.form.values[list(node[FORMS:])]
        errors, groups = CaseErrors(*at[OF_CASES]), GroupErrors(*at[OF_GROUPS])
        return Values(errors, at[BUDGET], at[ANATOMY], groups, forms)

    def smooth_newton(self, node: Node) -> float:
        """Largest amplitude [N] of what is smooth at a node."""
        return max(self.smooth_blocks(node).values(), default=0.0)

    def smooth_blocks(self, node: Node) -> dict[str, float]:
        """Amplitudes [N] of what is smooth at a node, by the block of its columns (see `Session.smooth`)."""
        key = node[SMOOTH:FORMS]
        if key not in self._smooth:
            carrier = self.carrier(node)
            posture = carrier if self._of_posture(node[CARRIER]) else ""
            tendon = carrier if 0 < node[CARRIER] <= self.tendons else posture
            of_family = (carrier, tendon, tendon, posture)
            sizes = [self.axes[k].value[node[k]] for k in range(SMOOTH, CARRIER)]
            self._smooth[key] = {f"{f}:{c}": v for f, c, v in zip(FAMILIES, of_family, sizes, strict=True) if v > 0.0}
        return self._smooth[key]

    def block_widths(self, node: Node) -> dict[str, float]:
        """Widths of the priors of the weights that act at a node, by their block (see `Linearised`).

        Effects' own parameters have a width of 1, and are no hyperparameter's.
        """
        if node not in self._widths:
            values = self.values(node)
            always = dict(zip(ACTING, (1.0, values.budget, values.anatomy), strict=True))
            of_groups = {name: size for name, size in values.groups._asdict().items() if size > 0.0}
            forms = {f"form{k}": error for k, error in enumerate(values.forms.tolist()) if error > 0.0}
            self._widths[node] = always | of_groups | self.smooth_blocks(node) | forms
        return self._widths[node]

    def without_smooth(self, node: Node) -> Node:
        """The same node without anything smooth."""
        return (*node[:SMOOTH], *[0] * len(FAMILIES), 0, *node[FORMS:])

    def as_named(self, node: Node) -> Node:
        """The same node without anything smooth, and with forms no further off than an effect's name allows."""
        most = int(np.flatnonzero(self.form.values <= settings.FORM_NAMED)[-1])
        return (*self.without_smooth(node)[:FORMS], *(min(most, i) for i in node[FORMS:]))

    def as_stated(self, node: Node) -> Node:
        """The same scatter, mounting and noise beside the measured one, with nothing smooth, and all else as stated."""
        noise = self.axes[NOISE].mode if self.noise_assumed else node[NOISE]
        usual = self.start(0)
        of_cases = (node[SCATTER], noise, *node[NOISE + 1 : BUDGET])
        return (*of_cases, *usual[BUDGET:GROUP], *node[OF_GROUPS], *usual[SMOOTH:])

    def sizes(self, node: Node) -> list[int]:
        """How many values each axis of a node has along which one may step."""
        of_axes = [1 if k == CARRIER else len(axis.values) for k, axis in enumerate(self.axes)]
        return of_axes + [len(self.form.values)] * (len(node) - FORMS)

    def neighbours(self, node: Node) -> list[Node]:
        """One step along one axis."""
        steps = [
            (*node[:k], index, *node[k + 1 :])
            for k, size in enumerate(self.sizes(node))
            for index in (node[k] - 1, node[k] + 1)
            if 0 <= index < size and k != CARRIER
        ]
        return list(dict.fromkeys(map(self.plainly, steps)))

    def returned(self, node: Node) -> list[Node]:
        """The same node with one axis back to where it is most probable before any reading."""
        steps = [(*node[:k], axis.mode, *node[k + 1 :]) for k, axis in enumerate(self._axes_of(node))]
        return list(dict.fromkeys(map(self.plainly, steps)))

    def widened(self, node: Node) -> list[Node]:
        """This node, and those with more scatter, noise or something smooth: there a bad case may be a sound one."""
        more = [
            (*node[:axis], index, *node[axis + 1 :])
            for axis in (*range(BUDGET), *range(GROUP, CARRIER))
            for index in range(node[axis] + 1, len(self.axes[axis].values))
        ]
        return list(dict.fromkeys([node, *more, *map(self.of_all, [node, *more])]))

    def narrowed(self, node: Node) -> list[Node]:
        """This node, and those with less of what a bad case may have raised: of one axis, or of all together."""
        modes = [axis.mode for axis in self.axes[:CARRIER]]
        usual = [(mode, (index + mode) // 2) for index, mode in zip(node[:CARRIER], modes, strict=True)]
        together = [(*(pair[k] for pair in usual), carrier) for k, carrier in ((0, 0), (1, node[CARRIER]))]
        less = [(axis, index) for axis, mode in enumerate(modes) for index in range(mode, node[axis])]
        single = [(*node[:axis], index, *node[axis + 1 : FORMS]) for axis, index in [*less, (CARRIER, 0)]]
        each = [(*some, *node[FORMS:]) for some in (node[:FORMS], *together, *single)]
        return list(dict.fromkeys(map(self.plainly, each)))


def _of_one_family(own: str, size: int) -> tuple[int, ...]:
    """Amplitudes by family of what is smooth in one of them alone, as indices on their axes."""
    return tuple(size * (family == own) for family in FAMILIES)


class Steps:
    """Steps between nodes, none of which is asked for its log joint twice; `known` are those that were asked for."""

    def __init__(self, log_joint: Callable[[Node], float]) -> None:
        self._log_joint = log_joint
        self.known: dict[Node, float] = {}

    def at(self, node: Node) -> float:
        """Log joint of a node."""
        if node not in self.known:
            self.known[node] = self._log_joint(node)
        return self.known[node]

    def best(self, nodes: Iterable[Node]) -> Node:
        """The most probable of some nodes."""
        return max(nodes, key=self.at)

    def climbed(self, start: Node, sizes: Sequence[int]) -> Node:
        """From a node along one axis after another to the best of its values, until none of them has a better one."""
        node, axis, stood = start, 0, 0
        while stood < len(sizes):
            before = node
            for step in (1, -1):
                while 0 <= node[axis] + step < sizes[axis]:
                    trial = (*node[:axis], node[axis] + step, *node[axis + 1 :])
                    if self.at(trial) <= self.at(node):
                        break
                    node = trial
                if node != before:
                    break
            stood = stood + 1 if node == before else 1
            axis = (axis + 1) % len(sizes)
        return node

    def explored(self, starts: Sequence[Node], neighbours: Callable[[Node], list[Node]]) -> dict[Node, float]:
        """Log joint of the nodes that matter: from the best one outwards, until all beyond are improbable.

        Neighbours are asked of nodes that are at most `WITHIN` less probable than the best, the best first, until
        `MOST_NODES` are known.
        """
        found = {node: self.at(node) for node in starts}
        ahead = set(found)
        while ahead and len(found) < MOST_NODES:
            node = max(ahead, key=lambda n: found[n])
            if found[node] < max(found.values()) - settings.WITHIN:
                break
            ahead.remove(node)
            new = [there for there in neighbours(node) if there not in found]
            found |= {there: self.at(there) for there in new}
            ahead.update(new)
        return found


def log_share(found: Mapping[Node, float]) -> float:
    """Log of the share of all that is probable which some nodes have, if the axes are independent of each other.

    Each axis is told by the log joint of the nodes that differ from the best one on it alone.
    """
    best = max(found, key=lambda n: found[n])
    nodes, ratio = np.array(list(found)), np.array(list(found.values())) - found[best]
    away = nodes != np.array(best)
    log_ratio, log_total = np.zeros(len(nodes)), 0.0
    for axis, index in enumerate(best):
        alone = away[:, axis] & (away.sum(axis=1) == 1)
        of_index = np.full(nodes[:, axis].max() + 1, -np.inf)
        of_index[nodes[alone, axis]] = ratio[alone]
        of_index[index] = 0.0
        log_ratio += of_index[nodes[:, axis]]
        log_total += float(logsumexp(of_index))
    return float(logsumexp(log_ratio)) - log_total
