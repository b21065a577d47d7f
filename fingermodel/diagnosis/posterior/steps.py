"""The nodes that matter: the most probable one, and those around it that are hardly less probable."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.settings import MOST_NODES, WITHIN

# A step that lost so much wherever it was taken is not taken again.
_LOST = 3.0 * WITHIN


class Steps:
    """Steps between nodes, none of which is asked for twice.

    Args:
        log_joint: of a node.

    Attributes:
        known: log joint of each node that was asked for.
    """

    def __init__(self, log_joint: Callable[[Node], float]) -> None:
        self._log_joint = log_joint
        self.known: dict[Node, float] = {}

    def at(self, node: Node) -> float:
        """Log joint of a node."""
        if node not in self.known:
            self.known[node] = self._log_joint(node)
        return self.known[node]

    def each(self, nodes: Sequence[Node]) -> list[float]:
        """The same of several."""
        return [self.at(node) for node in nodes]

    def best(self, nodes: Iterable[Node]) -> Node:
        """The most probable of some nodes."""
        return max(nodes, key=self.at)

    def climbed(self, start: Node, sizes: Sequence[int]) -> Node:
        """From a node along one axis after another to the best value there, until none of them has a better one.

        Args:
            start: where to begin.
            sizes: values of each axis.
        """
        node, axis, stood = start, 0, 0
        # By axis and direction, what the last step there lost.
        lost: dict[tuple[int, int], float] = {}
        while stood < len(sizes):
            before = node
            for step in (1, -1):
                while 0 <= node[axis] + step < sizes[axis] and lost.get((axis, step), 0.0) < _LOST:
                    trial = (*node[:axis], node[axis] + step, *node[axis + 1 :])
                    lost[axis, step] = self.at(node) - self.at(trial)
                    if lost[axis, step] >= 0.0:
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

        Args:
            starts: where to begin.
            neighbours: of a node.
        """
        found = dict(zip(starts, self.each(starts), strict=True))
        ahead = set(found)
        # The most that a step gained, wherever it was taken.
        gained: dict[Node, float] = {}
        while ahead and len(found) < MOST_NODES:
            node, most = max(ahead, key=lambda n: found[n]), max(found.values())
            if found[node] < most - WITHIN:
                break
            ahead.remove(node)
            steps = {there: _step(node, there) for there in neighbours(node)}
            least = most - _LOST - found[node]
            new = [there for there, step in steps.items() if there not in found and gained.get(step, least) >= least]
            found |= zip(new, self.each(new), strict=True)
            ahead.update(new)
            for there, step in steps.items():
                if there in found:
                    gained[step] = max(gained.get(step, -np.inf), found[there] - found[node])
        return found


def _step(node: Node, there: Node) -> Node:
    """From a node to another, wherever it is taken: each axis on which they differ, with its index at either."""
    return tuple(k for axis, (a, b) in enumerate(zip(node, there, strict=True)) if a != b for k in (axis, a, b))


def log_share(found: Mapping[Node, float]) -> float:
    """Log of the share of all that is probable which some nodes have, if the axes are independent of each other.

    Each axis is told by the nodes that differ from the best one on it alone.

    Args:
        found: log joint of each node.
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
