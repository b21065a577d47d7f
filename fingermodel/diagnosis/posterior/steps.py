"""The nodes that matter: the most probable one, and those around it that are hardly less probable."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.settings import WITHIN

# Most nodes of one explanation; those beyond count as if the axes were independent of each other.
MOST_NODES = 100


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
            if found[node] < max(found.values()) - WITHIN:
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
