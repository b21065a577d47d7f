"""A session linearised about a parameter vector: every Gaussian weight as a block of columns, and inner products.

Blocks are made, and multiplied, only when an evaluation asks for them.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.posterior.hyper import ACTING, OF_CASES, Hyperparameters, Node
from fingermodel.diagnosis.session_model.bad_cases import Apart, gain_if_bad
from fingermodel.diagnosis.session_model.candidates import Explanation, free_mask
from fingermodel.diagnosis.session_model.discrepancy import form_columns
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.session_model.whitening import NoiseWhitening, Whitened
from fingermodel.diagnosis.settings import LEVER_MM
from fingermodel.fitting.fit_report import held_at_bound
from fingermodel.fitting.identification import slopes_of
from fingermodel.fitting.roots import absorbed_by

# Names of the blocks; `torque:`, … of something smooth and `form0`, … besides.
HELD, BUDGET, ANATOMY = ACTING
OWN, OTHERS, RESIDUAL = "own", "others", "residual"

# Quadratics that are kept, those asked for last: about as many as the nodes around one have noises and sets of blocks.
_KEPT = 16
# Information of a weight from which rounding of inner products counts.
_STEEP = 1e12
# Share of the largest change from which a reading counts as touched by an effect.
_TOUCHED = 0.05


@dataclass(frozen=True, eq=False)
class Linearised:
    """A session linearised about the optimum of an explanation."""

    session: Session  # whose readings
    hyper: Hyperparameters  # axes of the hyperparameters
    explanation: Explanation  # what acts
    theta: Floats  # (parameters,)
    residual: Floats  # (n,) fitted readings less the model [N, N mm]
    slopes: Floats  # (n, parameters) of the model, per prior width
    changes: tuple[Floats, ...]  # (cases, 6) by each member [N, N mm]
    bad: frozenset[int]  # cases whose reading may be anything
    # What is asked once: by scatter and noise of a node, by what a quadratic is of, and by block.
    _inner: dict[Node, Whitened] = field(default_factory=dict, init=False, repr=False)
    _steep: dict[Node, bool] = field(default_factory=dict, init=False, repr=False)
    _latest: dict[tuple[object, ...], Quadratic] = field(default_factory=dict, init=False, repr=False)
    _effects: dict[tuple[tuple[str, ...], Node], Quadratic] = field(default_factory=dict, init=False, repr=False)
    _sizes: dict[str, int] = field(default_factory=dict, init=False, repr=False)
    # Of the validation readings, by the parameters about which they are linearised.
    _unseen: dict[bytes, tuple[Floats, Floats]] = field(default_factory=dict, init=False, repr=False)

    def but(self, **changed: Any) -> Self:
        """The same optimum with other readings or bad cases; errors of form stay those that are found here."""
        other = replace(self, **changed)
        other.__dict__["form_errors"] = self.form_errors
        return other

    def forget(self) -> None:
        """Let go of inner products; what is asked of them again is made again."""
        for known in (self._inner, self._latest, self._effects, self._unseen):
            known.clear()
        self.__dict__.pop("_steps", None)

    @cached_property
    def x(self) -> Floats:
        """(parameters,) in prior widths about the priors' centre."""
        problem = self.session.problem
        x = (self.theta - problem.centre) / problem.scale
        return np.where(np.abs(x) < 1e-9, 0.0, x)

    @cached_property
    def parameters_of(self) -> dict[str, Ints]:
        """Indices of the parameters in each block that has some; they come first in it."""
        problem, table = self.session.problem, self.session.model.parameters
        base = problem.free & ~held_at_bound(problem, self.theta)
        effects = table.of_kind("effect")
        own = np.array(self.explanation.parameters, dtype=np.intp)
        return {
            # Effects that the model has already.
            HELD: np.flatnonzero(base & effects),
            BUDGET: np.flatnonzero(base & table.of_kind("budget")),
            ANATOMY: np.flatnonzero(base & table.of_kind("anatomy")),
            OWN: own,
            OTHERS: np.setdiff1d(np.flatnonzero(effects & ~problem.free & (problem.sd > 0.0)), own),
        }

    def unseen_about(self, x: Floats) -> tuple[Floats, Floats]:
        """Validation readings (m,) of the model [N, N mm] and slopes (m, parameters), about `x` in prior widths."""
        if x.tobytes() not in self._unseen:
            session, problem = self.session, self.session.problem
            rows, theta = session.rows[~session.fitted], problem.centre + problem.scale * x
            free = problem.free | free_mask(session.model, self.explanation)
            reading = session.changes.readings(theta).reshape(-1)[rows]
            self._unseen[x.tobytes()] = reading, -slopes_of(replace(problem, free=free), theta, rows)
        return self._unseen[x.tobytes()]

    @cached_property
    def form_errors(self) -> list[Floats]:
        """Columns (all readings, k) of the error of form of each member that has a form."""
        session = self.session
        return [form_columns(session.changes.places, change, session.rows) for change in self._with_form]

    @property
    def _with_form(self) -> list[Floats]:
        """(cases, 6) by each member that has a form [N, N mm]."""
        return [c for m, c in zip(self.explanation.members, self.changes, strict=True) if m.candidate.has_form]

    @cached_property
    def form_errors_unseen(self) -> Floats:
        """Columns (validation readings, k) of the errors of form that no fitted case can show.

        They are of the cases beyond all fitted ones, by tendons that are loaded together at a mount.
        """
        session, cases = self.session, self.session.rows // 6
        new = session.beyond_fitted
        if not new.any():
            return np.zeros((int((~session.fitted).sum()), 0))
        of_set = new[:, None] & (session.load_sets[:, None] == np.unique(session.load_sets[new]))
        at = replace(session.changes.places, load=of_set[cases].astype(float))
        columns = [form_columns(at, change * new[:, None], session.rows) for change in self._with_form]
        return np.concatenate([np.zeros((len(cases), 0)), *columns], axis=1)[~session.fitted]

    @cached_property
    def sizes_newton(self) -> dict[str, float]:
        """What each member changes [N]: RMS over the fitted force components that it touches."""
        return {n: self.size_newton(c) for n, c in zip(self.explanation.names, self.changes, strict=True)}

    @property
    def newton(self) -> float:
        """What all members change together [N], in the same sense."""
        return self.size_newton(np.sum(self.changes, axis=0))

    @property
    def newton_mm(self) -> float:
        """What all members change the moments together [N mm], where that is what they mostly change; else 0."""
        if not self.changes:
            return 0.0
        size = self._size(np.sum(self.changes, axis=0), moments=True)
        return size if size > LEVER_MM * self.newton else 0.0

    def size_newton(self, change: Floats) -> float:
        """Size [N] of a change (cases, 6): RMS over the fitted force components that it touches."""
        return self._size(change, moments=False)

    def _size(self, change: Floats, *, moments: bool) -> float:
        """RMS over the fitted forces [N] or moments [N mm] that a change (cases, 6) touches."""
        session = self.session
        values = change.reshape(-1)[session.rows[session.fitted & ((session.rows % 6 >= 3) == moments)]]
        touched = np.abs(values) > _TOUCHED * max(np.abs(values).max(initial=0.0), 1e-12)
        return float(np.sqrt(np.mean(values[touched] ** 2))) if touched.any() else 0.0

    def block(self, name: str, rows: Mask, slopes: Floats) -> Floats:
        """Columns (n, k) of a block.

        Args:
            name: of it.
            rows: (all readings,) which readings.
            slopes: (n, parameters) of the model there, per prior width.
        """
        own, other = self.parameters_of.get(name), self.other_columns(name)
        if own is None:
            return other[rows]
        return np.concatenate([slopes[:, own], other[rows]], axis=1)

    def other_columns(self, name: str) -> Floats:
        """Columns (all readings, k) of what of a block is no parameter."""
        if name.startswith("form"):
            return self.form_errors[int(name.removeprefix("form"))]
        return self.session.columns(name)

    def place(self, name: str) -> Floats:
        """(k,) where the weights of a block stand: 0 for what is no parameter."""
        own = self.x[self.parameters_of[name]] if name in self.parameters_of else np.zeros(0)
        return np.concatenate([own, np.zeros(self.size(name) - len(own))])

    def size(self, name: str) -> int:
        """How many columns a block has."""
        if name not in self._sizes:
            self._sizes[name] = len(self.parameters_of.get(name, ())) + int(self.other_columns(name).shape[1])
        return self._sizes[name]

    def spans(self, names: Sequence[str]) -> list[slice]:
        """Where the weights of each of some blocks are among all of theirs."""
        sizes = [self.size(name) for name in names]
        ends = np.cumsum(sizes, dtype=int).tolist()
        return [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]

    def widths(self, names: Sequence[str], node: Node) -> Floats:
        """(k,) widths of the priors of all weights of some blocks at a node."""
        block = self.hyper.block_widths(node)
        return np.repeat([block.get(name, 1.0) for name in names], [self.size(name) for name in names])

    def places(self, names: Sequence[str]) -> Floats:
        """(k,) where all weights of some blocks stand."""
        return np.concatenate([self.place(name) for name in names])

    def acting(self, node: Node) -> list[str]:
        """Names of the blocks that act at a node, besides those of effects."""
        return list(self.hyper.block_widths(node))

    def quadratic(self, names: Sequence[str], node: Node) -> Quadratic:
        """Misfit as a function of the weights of some blocks, in their order."""
        inner = self._inner_at(node)
        # Nodes near each other mostly differ in the widths of the priors alone.
        key = (id(inner), *names)
        found = self._latest.pop(key, None) or self._assembled(inner, names)
        self._latest[key] = found
        if len(self._latest) > _KEPT:
            del self._latest[next(iter(self._latest))]
        return found

    def steep(self, node: Node) -> bool:
        """Whether slopes are so steep at a node that their inner products lose what is small beside the largest."""
        if (key := node[OF_CASES]) not in self._steep:
            slopes = [self._inner_at(node).of(name) for name in (HELD, BUDGET, ANATOMY, OWN)]
            self._steep[key] = max(float((s**2).sum(axis=0).max(initial=0.0)) for s in slopes) > _STEEP
        return self._steep[key]

    def _assembled(self, inner: Whitened, names: Sequence[str]) -> Quadratic:
        spans = self.spans(names)
        count = spans[-1].stop if spans else 0
        hessian, gradient = np.empty((count, count)), np.empty(count)
        for k, (a, of_a) in enumerate(zip(names, spans, strict=True)):
            gradient[of_a] = inner.inner(a, RESIDUAL)[:, 0]
            for b, of_b in zip(names[: k + 1], spans[: k + 1], strict=True):
                hessian[of_a, of_b] = inner.inner(a, b)
                hessian[of_b, of_a] = hessian[of_a, of_b].T
        misfit = float(inner.inner(RESIDUAL, RESIDUAL)[0, 0])
        return Quadratic(misfit, gradient, hessian, inner.noise.log_det)

    def _inner_at(self, node: Node) -> Whitened:
        key = node[OF_CASES]
        if key not in self._inner:
            # Columns are many times as large as their inner products, and made again in no time.
            for made in self._inner.values():
                made.columns.clear()
            smooth = self.session.whitened_smooth(self.hyper.values(node).errors, self.bad)
            # A cycle of references would keep all columns until the garbage collector runs.
            fit = weakref.proxy(self)
            self._inner[key] = Whitened(smooth.noise, lambda name: fit._plain(name), smooth)  # noqa: PLW0108
        return self._inner[key]

    def _plain(self, name: str) -> Floats:
        return self.residual[:, None] if name == RESIDUAL else self.block(name, self.session.fitted, self.slopes)

    def whitening(self, node: Node) -> NoiseWhitening:
        """Noise of the fitted readings at a node, by case and of the tares."""
        return self._inner_at(node).noise

    def whitened_at(self, names: Sequence[str], node: Node) -> tuple[Floats, Floats]:
        """(n, k) whitened columns of some blocks at a node, and (n,) whitened residual."""
        inner = self._inner_at(node)
        columns = np.concatenate([inner.of(name) for name in names], axis=1)
        return columns, inner.of(RESIDUAL)[:, 0]

    def marginal(self, node: Node) -> tuple[Floats, Floats]:
        """Everything that acts at a node, integrated out of the whitened readings.

        Returns:
            V (k, n), such that the inverse covariance of the whitened readings is 1 - Vᵀ V, and (n,) what is left.
        """
        across, left, _ = self._absorbed([*self.acting(node), OWN], node)
        return across, left

    def _absorbed(self, names: Sequence[str], node: Node) -> tuple[Floats, Floats, float]:
        """The same of some blocks alone, with the ln det that they add."""
        columns, residual = self.whitened_at(names, node)
        across, log_det = absorbed_by(columns * self.widths(names, node))
        return across, residual + columns @ self.places(names), log_det

    def effects_at(self, node: Node, *, forms: bool = True) -> tuple[Quadratic, Ints]:
        """All candidates' parameters, all else left open at a node, errors of form or not; and their indices."""
        first = tuple(n for n in self.acting(node) if forms or not n.startswith("form"))
        if (first, node) not in self._effects:
            across, left, log_det = self._absorbed(first, node)
            columns, _ = self.whitened_at([OWN, OTHERS], node)
            log_det += self.whitening(node).log_det
            self._effects[first, node] = Quadratic.beside(across, left, columns, log_det)
        return self._effects[first, node], np.concatenate([self.parameters_of[OWN], self.parameters_of[OTHERS]])

    def asked(self, columns: Floats, node: Node) -> tuple[Floats, Floats]:
        """What the readings say of each of further columns by itself: information (k,) and score (k,) of its weight.

        Columns and node are those of `quadratic_of`.
        """
        (across, left), new = self.marginal(node), self.whitening(node) @ columns
        turned = across @ new
        score = new.T @ left - turned.T @ (across @ left)
        return np.maximum((new**2).sum(axis=0) - (turned**2).sum(axis=0), 0.0), score

    def quadratic_of(self, columns: Floats, node: Node) -> Quadratic:
        """What the readings say of the weights of further columns together, beside everything that acts at a node.

        Args:
            columns: (fitted readings, k) change of the readings [N, N mm] per unit of each weight.
            node: of the hyperparameters.
        """
        # Counted from where these weights are 0.
        return replace(Quadratic.beside(*self.marginal(node), self.whitening(node) @ columns, 0.0), value=0.0)

    def left_out_gains(self, columns: Floats, node: Node, spread: float) -> Floats:
        """Log density (k,) that further columns add to the cases, each case predicted from all others.

        Args:
            columns: (fitted readings, k) change of the readings [N, N mm] per unit of a weight with prior N(0, 1).
            node: of the hyperparameters.
            spread: factor on all standard uncertainties.
        """
        whitening = self.whitening(node)
        (across, left), new = self.marginal(node), (whitening @ columns) / spread
        left = left / spread
        turned = new - across.T @ (across @ new)
        plain = left - across.T @ (across @ left)
        more = 1.0 + np.maximum(np.einsum("nk,nk->k", new, turned), 0.0)
        # The column takes u uᵀ from the inverse covariance.
        u = turned / np.sqrt(more)
        moved = whitening.by_case((plain[:, None] - u * (new.T @ plain / np.sqrt(more))).T).T
        u, plain = whitening.by_case(u.T).T, whitening.by_case(plain)
        out = np.zeros(columns.shape[1])
        for rows, _, blocks in self._blocks_by_case(across, node):
            inverse = np.linalg.inv(blocks + 1e-12 * np.eye(rows.shape[1]))
            before = np.einsum("gi,gij,gj->", plain[rows], inverse, plain[rows])
            cross = np.einsum("gik,gij,gjk->gk", u[rows], inverse, moved[rows])
            kept = np.maximum(1.0 - np.einsum("gik,gij,gjk->gk", u[rows], inverse, u[rows]), 1e-12)
            after = np.einsum("gik,gij,gjk->k", moved[rows], inverse, moved[rows]) + (cross**2 / kept).sum(axis=0)
            out += 0.5 * (before - after + np.log(kept).sum(axis=0))
        return out

    def _blocks_by_case(self, across: Floats, node: Node) -> Iterator[tuple[Ints, Floats, Floats]]:
        """Rows (g, L), inverse roots of the noise and blocks (g, L, L) of the inverse covariance in its units, by case.

        Args:
            across: (k, n) of all that acts (see `marginal`).
            node: of the hyperparameters.
        """
        whitening = self.whitening(node)
        every = np.concatenate([whitening.right.toarray(), whitening.by_case(across)])
        for rows, inverse in whitening.roots:
            mine = every[:, rows].transpose(1, 2, 0)
            yield rows, inverse, np.eye(rows.shape[1]) - mine @ mine.swapaxes(1, 2)

    def _precision(self, node: Node) -> list[tuple[Ints, Floats, Floats]]:
        """Rows (g, L), block (g, L, L) of the inverse covariance of all readings and score (g, L), by case."""
        across, left = self.marginal(node)
        a = self.whitening(node).by_case(left - across.T @ (across @ left))
        out = []
        for rows, inverse, blocks in self._blocks_by_case(across, node):
            turned = inverse.swapaxes(1, 2)
            out.append((rows, turned @ blocks @ inverse, (turned @ a[rows][..., None])[..., 0]))
        return out

    def log_odds_bad(self, node: Node) -> dict[int, float]:
        """Log evidence gained at a node by taking each fitted case (alone) for a bad one, prior not counted."""
        noise = self.session.fitted_noise
        out: dict[int, float] = {}
        for rows, precision, score in self._precision(node):
            size = noise.bad_size[rows]
            gain = gain_if_bad(size[:, :, None] * precision * size[:, None, :], size * score)
            out |= {int(c): float(g) for c, g in zip(noise.cases[rows[:, 0]], gain, strict=True)}
        return out

    def left_out(self, node: Node) -> dict[int, Apart]:
        """Each fitted case against what all others predict of it at a node."""
        session = self.session
        noise, component = session.fitted_noise, session.rows[session.fitted] % 6
        return {
            case: Apart.of(case, component[own], noise.bad_size[own], block, score, case in self.bad)
            for rows, precision, scores in self._precision(node)
            for own, block, score, case in zip(rows, precision, scores, noise.cases[rows[:, 0]].tolist(), strict=True)
        }
