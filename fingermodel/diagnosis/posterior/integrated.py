"""A linearised session with everything that acts integrated out: single cases, and what further columns would say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from fingermodel.arrays import Floats, Ints
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.linearised import OWN, Linearised
from fingermodel.diagnosis.session_model.bad_cases import Apart, gain_if_bad
from fingermodel.fitting.roots import root_of_one_plus


@dataclass(frozen=True, eq=False)
class Integrated(Linearised):
    """The readings of a linearised session at a node of the hyperparameters, whatever the weights are."""

    def marginal(self, node: Node) -> tuple[Floats, Floats]:
        """Everything that acts at a node, integrated out of the whitened readings.

        Returns:
            V (k, n), such that the inverse covariance of the whitened readings is 1 - Vᵀ V, and (n,) what is left.
        """
        names = [*self.acting(node), OWN]
        blocks, residual = self.whitened_at(names, node)
        left = residual + blocks @ self.places(names)
        columns = blocks * self.widths(names, node)
        return solve_triangular(root_of_one_plus(columns.T @ columns), columns.T, lower=True, check_finite=False), left

    def asked(self, columns: Floats, node: Node) -> tuple[Floats, Floats]:
        """What the readings say of further columns, each by itself, beside everything that acts at a node.

        Args:
            columns: (fitted readings, k) change of the readings [N, N mm] per unit of its weight.
            node: of the hyperparameters.

        Returns:
            Information (k,) of each weight, and its score (k,).
        """
        new, turned, score = self._beside(columns, node)
        return np.maximum((new**2).sum(axis=0) - (turned**2).sum(axis=0), 0.0), score

    def information(self, columns: Floats, node: Node) -> tuple[Floats, Floats]:
        """What the readings say of further columns together, beside everything that acts at a node.

        Args:
            columns: (fitted readings, k) change of the readings [N, N mm] per unit of each weight.
            node: of the hyperparameters.

        Returns:
            Information (k, k) of the weights, and their score (k,).
        """
        new, turned, score = self._beside(columns, node)
        return new.T @ new - turned.T @ turned, score

    def _beside(self, columns: Floats, node: Node) -> tuple[Floats, Floats, Floats]:
        """Further columns whitened, and turned into what all that acts takes away of them; score of their weights."""
        (across, left), new = self.marginal(node), self.whitening(node) @ columns
        turned = across @ new
        return new, turned, new.T @ left - turned.T @ (across @ left)

    def left_out_gains(self, columns: Floats, node: Node, spread: float = 1.0) -> Floats:
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
