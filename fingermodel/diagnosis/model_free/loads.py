"""Loads against loads: together and alone, at several levels, and again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.diagnosis.model_free.answer import (
    Estimate,
    Null,
    Residuals,
    Test,
    concluded,
    count,
    figure,
    not_tested,
    pm,
    vector,
)
from fingermodel.diagnosis.model_free.budget import Readings

# A load with the cases in which it hung.
Levels: TypeAlias = list[tuple[float, list[int]]]

# Loads closer than this are one level.
LEVEL_RATIO = 1.1


def superposition(r: Readings) -> Null:
    """Tendons together give the sum of what each gives alone, each at the load that it has."""
    name = "superposition"
    singles = r.groups(
        (i for i in r.loaded if len(r.masses[i]) == 1),
        lambda i: (*r.place(i), r.unloading[i], r.masses[i][0][0]),
    )
    together: list[int] = []
    sums: list[Floats] = []
    for i in r.loaded:
        alone = [singles.get((*r.place(i), r.unloading[i], muscle), []) for muscle, _ in r.masses[i]]
        if len(alone) > 1 and all(alone):
            together.append(i)
            sums.append(sum((_alone_at(r, cases, i) for cases in alone), np.zeros(len(r.wrench))))
    if not together:
        return not_tested(
            name, "No tendons were loaded together that were also loaded one by one in that posture and at that mount."
        )
    weights = np.array(sums)
    expected = weights @ r.wrench[:, :3]
    residual = r.forces(np.eye(len(r.wrench))[together] - weights)
    scale = residual.along("in proportion", expected.reshape(-1, 1))
    percent = 100.0 * residual.rms / max(float(np.sqrt(np.mean(expected**2))), 1e-9)
    cases = count(len(together), "case")
    amount = f"they differ by {figure(residual.rms)} N (RMS of {cases}, {figure(percent)} % of the force)"
    return concluded(
        r.observations,
        name,
        (residual.all("sum"), scale.test),
        f"Tendons loaded together give the sum of what each gives alone: {amount}.",
        f"Tendons loaded together do not give the sum of what each gives alone: {amount}; worst is "
        f"{r.worst(residual, together)}.",
        [*together, *np.flatnonzero(weights.any(axis=0)).tolist()],
    )


def _alone_at(r: Readings, cases: list[int], together: int) -> Floats:
    """Weights (n,) that bring one tendon's own readings to the load that it has in a case of several.

    In proportion from one level, else along the line through the two levels next to it.
    """
    same = [i for i in cases if r.stood(i) == r.stood(together)] or cases
    muscle = r.model.finger.topology.muscles.index(r.masses[same[0]][0][0])
    load = float(r.tension[together, muscle])
    levels = _levels(r, same)
    out = np.zeros(len(r.wrench))
    if len(levels) == 1:
        out[same] = load / float(r.load[same].sum())
        return out
    above = min(max(int(np.searchsorted([t for t, _ in levels], load)), 1), len(levels) - 1)
    (low, at_low), (high, at_high) = levels[above - 1], levels[above]
    share = (load - low) / (high - low)
    out[at_low] = (1.0 - share) / len(at_low)
    out[at_high] = share / len(at_high)
    return out


def _levels(r: Readings, cases: Iterable[int]) -> Levels:
    """Levels of load from the lowest, each with its cases."""
    out: Levels = []
    for i in sorted(cases, key=lambda i: float(r.load[i])):
        if out and r.load[i] < LEVEL_RATIO * out[-1][0]:
            out[-1][1].append(i)
        else:
            out.append((float(r.load[i]), [i]))
    return [(float(r.load[at].mean()), at) for _, at in out]


def load_levels(r: Readings) -> Null:
    """Forces grow in proportion to the load: nothing is left at no load, and the line does not bend."""
    name, n = "load_levels", len(r.wrench)
    same = r.groups(r.loaded, lambda i: (*r.stood(i), r.mix[i], r.unloading[i]))
    series = [levels for cases in same.values() if len(levels := _levels(r, cases)) > 1]
    if not series:
        return not_tested(name, "No tendon was loaded at two levels in the same posture and at the same mount.")
    at_zero, slope = np.zeros((len(series), n)), np.zeros((len(series), n))
    bends: list[Floats] = []
    bent: list[int] = []
    for row, levels in enumerate(series):
        mean = [_mean(r, cases) for _, cases in levels]
        load = np.array([x for x, _ in levels])
        off = load - load.mean()
        slope[row] = off @ np.array(mean) / (off @ off)
        at_zero[row] = np.mean(mean, axis=0) - load.mean() * slope[row]
        for k in range(1, len(levels) - 1):
            # Off the line between its neighbours.
            share = (load[k] - load[k - 1]) / (load[k + 1] - load[k - 1])
            bends.append(mean[k] - (1.0 - share) * mean[k - 1] - share * mean[k + 1])
            bent.append(levels[k][1][0])
    residual = r.forces(at_zero)
    tops = [levels[-1][1][0] for levels in series]
    hung = np.array([len(r.masses[i]) * r.newton_per_gram(i) for i in tops])
    hanger = residual.along("hanger", (slope @ r.wrench[:, :3] * hung[:, None]).reshape(-1, 1))
    places = list(dict.fromkeys(r.observations.locations[i] for i in tops))
    there = np.array([[r.observations.locations[i] == p for p in places] for i in tops], dtype=float)
    constant = residual.along("constant", np.kron(there, np.eye(3)))
    parts = [residual.all("no load"), hanger.test, constant.test]
    left = f"{figure(residual.rms)} N are left (RMS of {count(len(series), 'series', 'series')})"
    most = f"worst is {r.worst(residual, tops)}"
    bend = ""
    if bends:
        curve = r.forces(np.array(bends))
        parts.append(curve.all("bend"))
        bend = f"; over three or more levels the line bends by {figure(curve.rms)} N (RMS)"
        if parts[-1].p_value < parts[0].p_value:
            most = f"it bends most for {r.worst(curve, bent)}"
    grams = f"{pm(float(hanger.value[0]), float(hanger.sd[0]))} g"
    return concluded(
        r.observations,
        name,
        parts,
        f"Forces are in proportion to the load: drawn on to no load, {left}, like hangers of {grams}{bend}.",
        f"Forces are not in proportion to the load: drawn on to no load, {left}, "
        f"{_at_no_load(hanger, constant, places)}{bend}; {most}.",
        [i for levels in series for _, cases in levels for i in cases],
    )


def _at_no_load(hanger: Estimate, constant: Estimate, places: Sequence[str]) -> str:
    """Whether what is left at no load is that of unweighed hangers, of a constant force, or of neither."""
    grams = f"{pm(float(hanger.value[0]), float(hanger.sd[0]))} g"
    forces = [f"{vector(v)} N at the {p}" for p, v in zip(places, constant.value.reshape(-1, 3), strict=True)]
    hung, off = 100.0 * hanger.share, 100.0 * constant.share
    if max(hung, off) < 50.0:
        return (
            f"which neither an unweighed hanger explains ({grams}, {hung:.0f} % of the misfit) nor a zero that is off "
            f"({off:.0f} %)"
        )
    if hung >= off:
        return f"as if every loaded tendon carried {grams} more than stated ({hung:.0f} % of the misfit)"
    return f"as if the zero were off by {' and '.join(forces)} ({off:.0f} % of the misfit)"


@dataclass(frozen=True)
class _Again:
    """One comparison of a load with itself: its tests, what they say, where it is worst, and the cases used."""

    tests: tuple[Test, ...]
    said: str
    worst: str
    cases: list[int]


def repeats(r: Readings) -> Null:
    """The same load gives the same force: again, with the posture set anew, on unloading, and later."""
    found = [f for f in (_as_it_stood(r), _set_anew(r), _on_unloading(r)) if f is not None]
    if not found:
        return not_tested("repeats", "No load was hung a second time in the same posture and at the same mount.")
    differences = "; ".join(f.said for f in found)
    most = min(found, key=lambda f: min(t.p_value for t in f.tests)).worst
    return concluded(
        r.observations,
        "repeats",
        [t for f in found for t in f.tests],
        f"Loads that were hung again give the same force: {differences}.",
        f"Loads that were hung again do not give the same force: {differences}; worst is {most}.",
        [i for f in found for i in f.cases],
    )


def _mean(r: Readings, cases: Sequence[int]) -> Floats:
    out = np.zeros(len(r.wrench))
    out[cases] = 1.0 / len(cases)
    return out


def _compared(r: Readings, rows: list[Floats], cases: list[int]) -> tuple[Residuals, str, str, list[int]]:
    """Differences (k, n) as residuals, how large they are, where they are worst, and all cases in them."""
    weights = np.array(rows)
    residual = r.forces(weights)
    amount = f"{figure(residual.rms)} N (RMS of {len(rows)})"
    return residual, amount, r.worst(residual, cases), np.flatnonzero(weights.any(axis=0)).tolist()


def _as_it_stood(r: Readings) -> _Again | None:
    """Repeats with nothing touched in between, and what of their differences follows the clock."""
    groups = r.groups(r.loaded, lambda i: (*r.stood(i), r.masses[i], r.unloading[i])).values()
    pairs = [(first, later) for first, *others in groups for later in others]
    if not pairs:
        return None
    first, later = [i for i, _ in pairs], [j for _, j in pairs]
    unit = np.eye(len(r.wrench))
    residual, amount, most, cases = _compared(r, list(unit[later] - unit[first]), later)
    tests, said = [residual.all("repeats")], f"when repeated as it stood {amount}"
    elapsed, since = np.asarray(r.observations.inputs.elapsed), np.asarray(r.observations.inputs.since_tare)
    apart, waited = elapsed[later] - elapsed[first], since[later] - since[first]
    if np.abs(apart).max() > 1e-6:
        fade = residual.along("fade", (r.wrench[first, :3] * apart[:, None]).reshape(-1, 1))
        tests.append(fade.test)
        said += f", over the session a change of {pm(100.0 * float(fade.value[0]), 100.0 * float(fade.sd[0]))} %"
    if np.abs(waited).max() > 1e-6:
        zero = residual.along("zero", np.kron(waited[:, None], np.eye(3)))
        tests.append(zero.test)
        # Tares soon before every case leave a drift over the whole session unknown.
        if zero.sd.max() < 1.0:
            said += f" or of the zero by {vector(zero.value)} N"
    return _Again(tuple(tests), said, most, cases)


def _set_anew(r: Readings) -> _Again | None:
    """Repeats after the posture was set again or the cell moved."""
    rows: list[Floats] = []
    named: list[int] = []
    for cases in r.groups(r.loaded, lambda i: (*r.place(i), r.masses[i], r.unloading[i])).values():
        first, *others = r.groups(cases, r.stood).values()
        rows += [_mean(r, other) - _mean(r, first) for other in others]
        named += [other[0] for other in others]
    if not rows:
        return None
    residual, amount, most, used = _compared(r, rows, named)
    return _Again((residual.all("set anew"),), f"with posture or cell set anew {amount}", most, used)


def _on_unloading(r: Readings) -> _Again | None:
    """Loads reached by taking weight off, against the same reached by adding it."""
    rows: list[Floats] = []
    middle: list[Floats] = []
    named: list[int] = []
    for cases in r.groups(r.loaded, lambda i: (*r.stood(i), r.masses[i])).values():
        off, on = [i for i in cases if r.unloading[i]], [i for i in cases if not r.unloading[i]]
        if off and on:
            rows.append(_mean(r, off) - _mean(r, on))
            middle.append(0.5 * (_mean(r, off) + _mean(r, on)) @ r.wrench[:, :3])
            named.append(off[0])
    if not rows:
        return None
    residual, amount, most, used = _compared(r, rows, named)
    kept = residual.along("hysteresis", np.concatenate(middle)[:, None])
    share = pm(100.0 * float(kept.value[0]), 100.0 * float(kept.sd[0]))
    said = f"on unloading against loading {amount}, {share} % of the force"
    return _Again((residual.all("unloading"), kept.test), said, most, used)
