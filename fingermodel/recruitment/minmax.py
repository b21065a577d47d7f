"""Min/max recruitment: share joint torques among muscles so that the busiest is as little busy as can be.

Minimise the largest activity f_i / F_i subject to R f = τ and 0 ≤ f ≤ F (Rasmussen et al. 2001; Wu et al. 2008, Eq 3),
a linear programme. Where the muscles at the largest activity leave freedom to the others, those at the bound are kept
and the largest activity of the rest is made least in turn, until everything is determined.

A basis of the programme (which muscles are free, at the largest activity, at rest) that is optimal at one instant is
mostly so at many. So one instant is solved by HiGHS, and its basis is tried at all others at once; it is kept where it
is both feasible and optimal, which for a linear programme is a proof. What remains is solved in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.intp]
# Activities and prices (which add up to one) are of order one at most.
_TOLERANCE = 1e-9
_PRICED = 1e-7


@dataclass(frozen=True, eq=False)
class Recruitment:
    """Muscle forces over time.

    Attributes:
        force: (n, muscles) [N].
        activity: (n, muscles) force over strength.
        largest: (n,) activity of the busiest muscle.
        programmes: how many linear programmes were solved one by one.
    """

    force: Floats
    activity: Floats
    largest: Floats
    programmes: int


class RecruitmentError(ModelError):
    """The muscles cannot carry a torque.

    Attributes:
        index: of the instant.
        reserve: (rotations,) least torque that something else would have to add there [N mm].
    """

    def __init__(self, found: str, expected: str, remedy: str, index: int, reserve: Floats) -> None:
        super().__init__(found, expected, remedy)
        self.index, self.reserve = index, reserve


class _Basis(NamedTuple):
    """A basis of one programme: indices among its muscles, and the equations that determine it."""

    free: Ints
    most: Ints
    rest: Ints
    rows: Ints


class _Tried(NamedTuple):
    """What a basis gives at many instants.

    Attributes:
        good: (n,) feasible and optimal.
        activity: (n, muscles of the programme).
        largest: (n,).
        price: (n, muscles of the programme) of the bound that each is at; 0 where it is free.
    """

    good: Flags
    activity: Floats
    largest: Floats
    price: Floats


def min_max(
    moments: Floats, torque: Floats, strength: Floats, *, rotations: tuple[str, ...], times_s: Floats | None = None
) -> Recruitment:
    """Share torques among muscles at many instants.

    Args:
        moments: (n, rotations, muscles) torque of a unit tension [mm].
        torque: (n, rotations) to be carried [N mm].
        strength: (muscles,) or (n, muscles) greatest force [N], above zero.
        rotations: names, for errors.
        times_s: (n,) for errors.

    Raises:
        RecruitmentError: an instant at which the muscles cannot carry the torque.
    """
    strength = np.broadcast_to(np.asarray(strength, dtype=float), (len(torque), moments.shape[2]))
    # Unit rows: a tolerance means the same at every joint.
    size = np.abs(moments * strength[:, None, :]).max(axis=2, keepdims=True)
    matrix = np.where(size > 0.0, moments * strength[:, None, :] / np.where(size > 0.0, size, 1.0), 0.0)
    right = torque / np.where(size[..., 0] > 0.0, size[..., 0], 1.0)
    work = _Stages(matrix, right)
    try:
        work.run()
    except _UnsolvableError as fault:
        raise _explained(moments, torque, strength, fault.index, rotations, times_s) from None
    largest = work.activity.max(axis=1)
    weak = np.flatnonzero(largest > 1.0 + 1e-7)
    if len(weak):
        raise _explained(moments, torque, strength, int(weak[0]), rotations, times_s)
    return Recruitment(work.activity * strength, work.activity, largest, work.programmes)


def reserve_torques(moments: Floats, torque: Floats, strength: Floats) -> Floats:
    """Least torques that something else would have to add at one instant, summed over the rotations [N mm].

    Args:
        moments: (rotations, muscles) [mm].
        torque: (rotations,) [N mm].
        strength: (muscles,) [N].
    """
    from scipy.optimize import linprog

    count, muscles = moments.shape
    identity = np.eye(count)
    answer = linprog(
        np.concatenate([np.zeros(muscles), np.ones(2 * count)]),
        A_eq=np.hstack([moments, identity, -identity]),
        b_eq=torque,
        bounds=[*((0.0, float(f)) for f in strength), *[(0.0, None)] * (2 * count)],
        method="highs",
    )
    solution = np.asarray(answer.x)
    added: Floats = solution[muscles : muscles + count] - solution[muscles + count :]
    return added


class _UnsolvableError(Exception):
    def __init__(self, index: int) -> None:
        super().__init__(index)
        self.index = index


class _Stages:
    """The programmes of all instants, stage by stage, those with the same muscles left taken together."""

    def __init__(self, matrix: Floats, right: Floats) -> None:
        self.matrix, self.right = matrix, right
        self.activity = np.zeros((len(matrix), matrix.shape[2]))
        self.programmes = 0

    def run(self) -> None:
        pending: dict[tuple[int, ...], Ints] = {
            tuple(range(self.matrix.shape[2])): np.arange(len(self.matrix)),
        }
        while pending:
            # Those with most muscles left first: what they leave joins the others.
            left = max(pending, key=len)
            for following, indices in self._stage(np.array(left, dtype=np.intp), pending.pop(left)):
                known = pending.get(following)
                pending[following] = indices if known is None else np.concatenate([known, indices])

    def _stage(self, left: Ints, indices: Ints) -> list[tuple[tuple[int, ...], Ints]]:
        """Solve one programme for all these instants; what is still open goes on with fewer muscles."""
        matrix = self.matrix[indices][:, :, left]
        settled = np.setdiff1d(np.arange(self.matrix.shape[2]), left)
        right = self.right[indices]
        carried = np.einsum("nrm,nm->nr", self.matrix[indices][:, :, settled], self.activity[indices][:, settled])
        right = right - carried
        following: list[tuple[tuple[int, ...], Ints]] = []
        idle = np.abs(right).max(axis=1, initial=0.0) <= 1e-13 * (1.0 + np.abs(self.right[indices]).max(axis=1))
        self.activity[np.ix_(indices[idle], left)] = 0.0
        open_ = np.flatnonzero(~idle)
        while len(open_):
            at = open_[0]
            found, own = self._programme(matrix[at], right[at], int(indices[at]))
            tried = _try(found, matrix[open_], right[open_])
            if not tried.good[0]:
                # A degenerate corner whose basis does not prove itself: HiGHS's own answer stands.
                tried = _Tried(np.ones(1, bool), *(np.stack([part]) for part in own))
                chosen = open_[:1]
            else:
                chosen = open_[tried.good]
                tried = _Tried(
                    tried.good[tried.good],
                    tried.activity[tried.good],
                    tried.largest[tried.good],
                    tried.price[tried.good],
                )
            following += self._settle(left, indices[chosen], tried, matrix[chosen])
            open_ = np.setdiff1d(open_, chosen, assume_unique=True)
        return following

    def _settle(self, left: Ints, indices: Ints, tried: _Tried, matrix: Floats) -> list[tuple[tuple[int, ...], Ints]]:
        """Keep what a programme decides, and group what it leaves open."""
        self.activity[np.ix_(indices, left)] = tried.activity
        decided = tried.price > _PRICED
        following = []
        for pattern in np.unique(decided, axis=0):
            rows = np.flatnonzero((decided == pattern).all(axis=1))
            rest = np.flatnonzero(~pattern)
            if len(rest) == 0:
                continue
            # Where the equations alone fix the rest, nothing is left to be shared.
            open_ = np.linalg.matrix_rank(matrix[rows][:, :, rest], tol=1e-9) < len(rest)
            if open_.any():
                following.append((tuple(int(i) for i in left[rest]), indices[rows[open_]]))
        return following

    def _programme(self, matrix: Floats, right: Floats, index: int) -> tuple[_Basis, tuple[Floats, Floats, Floats]]:
        """Solve one instant by HiGHS; return the basis, and activities, largest activity and prices."""
        from scipy.optimize import linprog

        rows, count = matrix.shape
        self.programmes += 1
        answer = linprog(
            np.append(np.zeros(count), 1.0),
            A_ub=np.hstack([np.eye(count), -np.ones((count, 1))]),
            b_ub=np.zeros(count),
            A_eq=np.hstack([matrix, np.zeros((rows, 1))]),
            b_eq=right,
            bounds=(0.0, None),
            method="highs-ds",
            options={"presolve": False},
        )
        if answer.status != 0:
            raise _UnsolvableError(index)
        solution = np.asarray(answer.x)
        activity, largest = solution[:-1], float(solution[-1])
        upper, lower = -answer.ineqlin.marginals, answer.lower.marginals[:-1]
        scale = max(largest, 1e-12)
        at_most = (activity >= largest - 1e-9 * scale) | (upper > _PRICED)
        at_rest = ~at_most & ((activity <= 1e-9 * scale) | (lower > _PRICED))
        price = np.where(at_most, np.maximum(upper, 0.0), np.where(at_rest, np.maximum(lower, 0.0), 0.0))
        basis = _basis(matrix, at_most, at_rest, price)
        return basis, (activity, np.array(largest), price)


def _basis(matrix: Floats, at_most: Flags, at_rest: Flags, price: Floats) -> _Basis:
    """Muscles and equations of a square basis; in a degenerate corner muscles without price join the free ones."""
    free = [int(i) for i in np.flatnonzero(~(at_most | at_rest))]
    most = [int(i) for i in np.flatnonzero(at_most)]

    def columns(chosen: list[int], bound: list[int]) -> Floats:
        return np.column_stack([matrix[:, chosen], matrix[:, bound].sum(axis=1)])

    rank = np.linalg.matrix_rank(columns(free, most), tol=1e-9)
    whole = np.linalg.matrix_rank(matrix, tol=1e-9)
    for i in (int(i) for i in np.flatnonzero((at_most | at_rest) & (price <= _PRICED))):
        if rank >= whole or (most == [i]):
            break
        bound = [m for m in most if m != i]
        grown = np.linalg.matrix_rank(columns([*free, i], bound), tol=1e-9)
        if grown > rank:
            free, most, rank = [*free, i], bound, grown
    square = columns(free, most)
    rows = _independent(square)
    rest = [i for i in range(matrix.shape[1]) if i not in free and i not in most]
    return _Basis(*(np.array(part, dtype=np.intp) for part in (free, most, rest, rows)))


def _independent(columns: Floats) -> list[int]:
    """As many independent rows as there are columns, by elimination with the largest pivot."""
    work, chosen = columns.copy(), []
    for column in range(work.shape[1]):
        candidates = [r for r in range(len(work)) if r not in chosen]
        if not candidates:
            break
        pivot = max(candidates, key=lambda r: abs(work[r, column]))
        if abs(work[pivot, column]) < 1e-12:
            break
        chosen.append(pivot)
        for r in candidates:
            if r != pivot:
                work[r] -= work[pivot] * (work[r, column] / work[pivot, column])
    return chosen


def _try(basis: _Basis, matrix: Floats, right: Floats) -> _Tried:
    """Solve the basis at many instants, and hold the answer against the conditions of an optimum."""
    count, muscles = len(matrix), matrix.shape[2]
    size = len(basis.free) + 1
    activity, price = np.zeros((count, muscles)), np.zeros((count, muscles))
    if len(basis.rows) != size or len(basis.most) == 0:
        return _Tried(np.zeros(count, bool), activity, np.zeros(count), price)
    bound = matrix[:, :, basis.most].sum(axis=2, keepdims=True)
    square = np.concatenate([matrix[:, :, basis.free], bound], axis=2)[:, basis.rows]
    regular = np.abs(np.linalg.det(square)) > 1e-12
    square = np.where(regular[:, None, None], square, np.eye(size))
    solved = np.linalg.solve(square, right[:, basis.rows, None])[..., 0]
    ones = np.zeros((count, size, 1))
    ones[:, -1] = 1.0
    dual = np.linalg.solve(square.transpose(0, 2, 1), ones)[..., 0]
    largest = solved[:, -1]
    activity[:, basis.free] = solved[:, :-1]
    activity[:, basis.most] = largest[:, None]
    worth = np.einsum("nrm,nr->nm", matrix[:, basis.rows], dual)
    price[:, basis.most] = worth[:, basis.most]
    price[:, basis.rest] = -worth[:, basis.rest]
    slack = _TOLERANCE * np.maximum(largest, 1e-9)[:, None]
    feasible = ((activity >= -slack) & (activity <= largest[:, None] + slack)).all(axis=1)
    balanced = np.einsum("nrm,nm->nr", matrix, activity) - right
    held = np.abs(balanced).max(axis=1) <= 1e-10 * (np.abs(right).max(axis=1) + 1e-300)
    optimal = (price >= -_TOLERANCE).all(axis=1)
    return _Tried(
        regular & feasible & held & optimal & (largest > 0.0),
        np.clip(activity, 0.0, np.maximum(largest, 0.0)[:, None]),
        largest,
        price,
    )


def _explained(
    moments: Floats, torque: Floats, strength: Floats, index: int, rotations: tuple[str, ...], times_s: Floats | None
) -> RecruitmentError:
    reserve = reserve_torques(moments[index], torque[index], strength[index])
    worst = int(np.argmax(np.abs(reserve)))
    when = f"at {times_s[index]:g} s" if times_s is not None else f"at instant {index}"
    asked = ", ".join(f"{name} {t:.4g}" for name, t in zip(rotations, torque[index], strict=True))
    lacks = ", ".join(
        f"{name} {r:.4g}" for name, r in zip(rotations, reserve, strict=True) if abs(r) >= 1e-9 * abs(reserve).max()
    )
    return RecruitmentError(
        f"the muscles lack strength about {rotations[worst]} {when}: asked for {asked} N mm",
        f"torques within their reach; a reserve of {lacks} N mm would do",
        "Check signs and size of the tip force and of the angles, or give stronger muscles",
        index,
        reserve,
    )
