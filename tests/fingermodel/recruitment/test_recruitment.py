"""Min/max recruitment against the conditions of its optimum, written independently; moment arms of whole muscles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.optimize import linprog

from fingermodel.fingers.files import read_finger
from fingermodel.recruitment.minmax import Recruitment, RecruitmentError, min_max, reserve_torques
from fingermodel.recruitment.moments import arms_and_excursions

Floats = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)
NAMES = ("a", "b", "c", "d")


def _problem(seed: int, count: int = 6) -> tuple[Floats, Floats, Floats]:
    """Moment arms that change a little over time, torques that muscles can carry, and strengths.

    Some muscles cross only the first joints and some are alike, as in a finger; so largest activities leave freedom.
    """
    rng = np.random.default_rng(seed)
    rotations, muscles = int(rng.integers(2, 5)), int(rng.integers(5, 9))
    arms = rng.normal(size=(rotations, muscles)) * 8.0
    reach = rng.integers(1, rotations + 1, size=muscles)
    arms[np.arange(rotations)[:, None] >= reach] = 0.0
    if seed % 3 == 0:
        arms[:, 1] = arms[:, 0]
    moving = arms * (1.0 + 0.1 * rng.normal(size=(count, rotations, muscles)))
    strength = rng.uniform(5.0, 150.0, muscles)
    torque = np.einsum("nrm,nm->nr", moving, rng.uniform(0.0, 0.6, (count, muscles)) * strength)
    return moving, torque, strength


def _share(problem: tuple[Floats, Floats, Floats]) -> Recruitment:
    arms, torque, strength = problem
    return min_max(arms, torque, strength, rotations=NAMES[: torque.shape[1]])


def _ordered(arms: Floats, torque: Floats, strength: Floats) -> Floats:
    """Activities with the largest least, then the next, by asking of each muscle whether it could do with less.

    Stage by stage: the least bound on all muscles that are still open; then a muscle is settled if, under that bound,
    its activity cannot be any less.
    """
    matrix = arms * strength
    count = matrix.shape[1]
    settled: dict[int, float] = {}

    def solve(cost: Floats, bound: float | None) -> tuple[Floats, float]:
        open_ = [i for i in range(count) if i not in settled]
        limits: list[tuple[float, float | None]] = [
            (max(settled[i] - 1e-8, 0.0), settled[i] + 1e-8) if i in settled else (0.0, bound) for i in range(count)
        ]
        upper = np.zeros((len(open_), count + 1))
        for row, i in enumerate(open_):
            upper[row, i], upper[row, -1] = 1.0, -1.0
        answer = linprog(
            cost,
            A_ub=upper,
            b_ub=np.zeros(len(open_)),
            A_eq=np.hstack([matrix, np.zeros((len(matrix), 1))]),
            b_eq=torque,
            bounds=[*limits, (0.0, None)],
            method="highs",
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        assert answer.status == 0
        return np.asarray(answer.x)[:-1], float(answer.fun or 0.0)

    while len(settled) < count:
        last = np.append(np.zeros(count), 1.0)
        values, bound = solve(last, None)
        # Room for rounding, far below what separates the stages of random problems.
        room = bound + 1e-9
        fixed = {}
        for i in range(count):
            if i not in settled:
                cost = np.append(np.eye(count)[i], 0.0)
                _, least = solve(cost, room)
                _, most = solve(-cost, room)
                if least > bound - 1e-6 or -most < 1e-6 or -most - least < 1e-6:
                    fixed[i] = max(least, 0.0)
        if not fixed:
            return np.array([settled.get(i, values[i]) for i in range(count)])
        settled |= {i: float(np.clip(v, 0.0, room)) for i, v in fixed.items()}
        if bound < 1e-9:
            break
    return np.array([settled.get(i, 0.0) for i in range(count)])


@given(seed=seeds)
def test_torques_are_carried_within_bounds_by_the_least_largest_activity(seed: int) -> None:
    arms, torque, strength = problem = _problem(seed)
    found = _share(problem)
    assert_allclose(np.einsum("nrm,nm->nr", arms, found.force), torque, atol=1e-9 * np.abs(torque).max())
    assert (found.activity >= 0.0).all()
    assert_allclose(found.force, found.activity * strength)
    for t in range(len(torque)):
        # Duality: no price on torques with Σ max(0, Aᵀλ) ≤ 1 is worth more than the optimum.
        matrix = arms[t] * strength
        count, muscles = matrix.shape
        dual = linprog(
            np.concatenate([-torque[t], np.zeros(muscles)]),
            A_ub=np.vstack(
                [np.hstack([matrix.T, -np.eye(muscles)]), np.append(np.zeros(count), np.ones(muscles))[None]]
            ),
            b_ub=np.append(np.zeros(muscles), 1.0),
            bounds=[(None, None)] * count + [(0.0, None)] * muscles,
            method="highs",
        )
        assert dual.fun is not None
        assert_allclose(found.largest[t], -dual.fun, rtol=1e-7, atol=1e-9)


@settings(max_examples=15)
@given(seed=seeds)
def test_the_rest_is_shared_out_by_the_same_rule(seed: int) -> None:
    arms, torque, strength = problem = _problem(seed, 2)
    found = _share(problem)
    for t in range(len(torque)):
        expected = np.sort(_ordered(arms[t], torque[t], strength))[::-1]
        assert_allclose(np.sort(found.activity[t])[::-1], expected, atol=2e-5)


@given(seed=seeds, factor=st.floats(0.01, 1.5))
def test_twice_the_torque_is_twice_the_force(seed: int, factor: float) -> None:
    arms, torque, strength = problem = _problem(seed, 3)
    once, scaled = _share(problem), _share((arms, factor * torque, strength))
    assert_allclose(scaled.force, factor * once.force, atol=1e-8 * strength.max())


@given(seed=seeds)
def test_instants_do_not_know_of_each_other(seed: int) -> None:
    """One at a time, or in another order, is the same."""
    arms, torque, strength = _problem(seed, 5)
    together = _share((arms, torque, strength)).force
    backwards = _share((arms[::-1], torque[::-1], strength)).force[::-1]
    alone = np.concatenate([_share((arms[t : t + 1], torque[t : t + 1], strength)).force for t in range(5)])
    assert_allclose(backwards, together, atol=1e-7 * strength.max())
    assert_allclose(alone, together, atol=1e-7 * strength.max())


def test_two_alike_share_alike() -> None:
    arms = np.array([[[4.0, 4.0, -3.0]]])
    found = min_max(arms, np.array([[10.0]]), np.array([10.0, 30.0, 20.0]), rotations=("a",))
    assert_allclose(found.activity, [[0.0625, 0.0625, 0.0]])


def test_without_torque_nothing_is_active() -> None:
    arms = np.array([[[4.0, 4.0, -3.0]]])
    found = min_max(arms, np.zeros((1, 1)), np.array([10.0, 30.0, 20.0]), rotations=("a",))
    assert_allclose(found.force, 0.0)
    assert found.programmes == 0


@pytest.mark.parametrize(
    ("torque", "reserve"),
    [([0.0, 30.0], [0.0, 10.0]), ([-5.0, 8.0], [-5.0, 0.0])],
    ids=["beyond their strength", "beyond their reach"],
)
def test_too_weak_is_said_with_time_joint_and_reserve(torque: list[float], reserve: list[float]) -> None:
    arms = np.array([[[2.0, 0.0], [0.0, 2.0]]] * 2)
    asked = np.array([[1.0, 1.0], torque])
    with pytest.raises(RecruitmentError) as caught:
        min_max(arms, asked, np.array([10.0, 10.0]), rotations=("MCP", "PIP"), times_s=np.array([0.0, 0.25]))
    assert caught.value.index == 1
    assert_allclose(caught.value.reserve, reserve, atol=1e-7)
    joint = ("MCP", "PIP")[int(np.argmax(np.abs(reserve)))]
    assert f"lack strength about {joint} at 0.25 s" in str(caught.value)
    assert "\n" not in str(caught.value)


@given(seed=seeds)
def test_the_reserve_makes_the_torque_possible(seed: int) -> None:
    arms, torque, strength = _problem(seed, 1)
    asked = 5.0 * torque[0] - 3.0
    reserve = reserve_torques(arms[0], asked, strength)
    found = min_max(arms, (asked - reserve)[None], strength * (1.0 + 1e-5), rotations=NAMES[: len(asked)])
    assert found.largest[0] <= 1.0 + 1e-6


@settings(max_examples=20)
@given(seed=seeds)
def test_a_muscles_excursion_does_the_torques_work(seed: int) -> None:
    """dl/dq = −R, along any way: in flexion, where extensors wrap, and in the plane, where the way does not matter."""
    rng = np.random.default_rng(seed)
    finger = read_finger("wu2008_index")
    start, end = rng.uniform([0.0, 0.1, 0.1, 0.1], [0.0, 1.0, 1.0, 0.8], (2, 4))
    h = 1e-5
    way = rng.normal(size=4) * [0.0, 1.0, 1.0, 1.0]
    arms, longer = arms_and_excursions(
        finger.topology, finger.values, start, np.stack([end, end + h * way, end - h * way])
    )
    assert_allclose((longer[1] - longer[2]) / (2 * h), -way @ arms[0], atol=1e-5)
