"""What may be said of several sessions together: what they share, that it is nothing, or that it is not settled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fingermodel.compare import compare
from fingermodel.diagnosis.diagnose import UNTESTED, Diagnosis, validation_rmse
from fingermodel.diagnosis.questioned import CLEAR_ODDS
from fingermodel.diagnosis.shared import InSession, SharedEffect
from fingermodel.diagnosis.verdict import LEAST_CASES, MOST_NAMES, SURE, Kind, believable, rises, typical_sd

# Log odds by which an effect that has a size of its own in each session must show in every one.
CLEAR_GAIN = 2.3


@dataclass(frozen=True)
class PooledVerdict:
    """What the sessions say together, and why.

    Attributes:
        kind: of the verdict.
        names: candidates that it names.
        probability: of the verdict.
        sentence: in plain words.
        short: what was short of a stronger verdict.
        rests_on: sessions without which nothing that is shared would be found.
    """

    kind: Kind
    names: tuple[str, ...]
    probability: float
    sentence: str
    short: tuple[str, ...] = ()
    rests_on: tuple[str, ...] = ()


def judge_together(
    sessions: Sequence[str],
    diagnoses: Sequence[Diagnosis],
    ranking: Sequence[SharedEffect],
    apart: tuple[float, float, float],
    without: Sequence[tuple[tuple[str, ...], float]],
) -> PooledVerdict:
    """Decide what sessions share.

    Args:
        sessions: ids.
        diagnoses: of each by itself.
        ranking: what may be shared, best first.
        apart: probability that nothing is shared; of that, that nothing is missing in any, and that in each it is
            something outside the catalogue.
        without: for each session what is favoured without it, and by how much more than the first of the ranking; none
            where there are too few to leave any out.
    """
    p_apart, p_nothing, p_other = apart
    included: dict[str, float] = {}
    for effect in ranking:
        for name in effect.names:
            included[name] = included.get(name, 0.0) + effect.probability
    certain = _without_passengers({name for name, p in included.items() if p >= SURE}, diagnoses, ranking)
    exact = next((e for e in ranking if set(e.names) == certain), None)
    if exact is not None:
        return _found(sessions, diagnoses, exact, min(included[n] for n in certain), without)
    if p_apart >= SURE:
        kinds = {d.verdict.kind for d in diagnoses}
        if kinds == {"nothing_missing"}:
            return PooledVerdict("nothing_missing", (), p_nothing, "Taken together, nothing is missing in any session.")
        if kinds == {"none_of_catalogue"}:
            text = "Something is missing in every session that no effect here describes."
            return PooledVerdict("none_of_catalogue", (), p_other, text)
        return PooledVerdict("undecided", (), p_apart, f"The sessions share no effect: {_each(sessions, diagnoses)}.")
    chosen, total = [], 0.0
    for effect in [e for e in ranking if len(e.names) == 1][:MOST_NAMES]:
        chosen.append(effect.names[0])
        total += effect.probability
        if total >= SURE:
            text = f"One of {', '.join(chosen)}; the sessions together do not tell which."
            return PooledVerdict("one_of", tuple(chosen), total, text)
    likely = ranking[0] if ranking else None
    short = [f"they share nothing with a probability of {p_apart:.2f}"]
    if likely is not None:
        short.append(f"{_words(likely.names)} has {likely.probability:.2f}")
    text = "Undecided: together the sessions single out no effect that they share."
    return PooledVerdict("undecided", (), max(included.values(), default=0.0), text, tuple(short))


def _without_passengers(certain: set[str], diagnoses: Sequence[Diagnosis], ranking: Sequence[SharedEffect]) -> set[str]:
    """Of two effects, leave out one that the sessions by themselves seldom name.

    What makes up for the form of a true effect does so in every session alike, and would be taken for a second one.
    """
    if len(certain) < 2:
        return certain
    named = {name: sum(name in d.verdict.names for d in diagnoses) for name in certain}
    kept = {name for name, count in named.items() if 2 * count >= len(diagnoses)}
    if kept:
        return kept
    best = next((e.names[0] for e in ranking if len(e.names) == 1 and e.names[0] in certain), None)
    return certain if best is None else {best}


def _found(
    sessions: Sequence[str],
    diagnoses: Sequence[Diagnosis],
    effect: SharedEffect,
    probability: float,
    without: Sequence[tuple[tuple[str, ...], float]],
) -> PooledVerdict:
    stands = [k for k, each in enumerate(effect.each) if each.beside.own is not None]
    unknown = [s for k, s in enumerate(sessions) if k not in stands]
    if len(stands) < max(2, len(sessions) // 2 + 1):
        text = (
            f"Something is missing that no effect here describes, in {_words(unknown)}. With {_words(effect.names)} "
            "beside it less would be left, which is no reason to believe in that."
        )
        return PooledVerdict("none_of_catalogue", (), probability, text)
    lacks = [*_thin(diagnoses), *_unbelievable(sessions, diagnoses, effect, stands)]
    other_law = [sessions[k] for k in stands if effect.each[k].beside.weighed.may_be_another_law]
    if 2 * len(other_law) > len(stands):
        lacks.append(f"in {_words(other_law)} its law would have to be another, so far off would its form be")
    apart = [s for s, each in zip(sessions, effect.each, strict=True) if each.gain < CLEAR_GAIN]
    if apart and not effect.shared:
        lacks.append(f"it does not show in {_words(apart)}, and has no one size in all")
    rests = []
    for session, (winner, ahead) in zip(sessions, without, strict=bool(without)):
        if ahead <= CLEAR_ODDS or set(effect.names) <= set(winner):
            continue
        if winner and not set(winner) < set(effect.names):
            lacks.append(f"without {session} it would be {_words(winner)}")
        else:
            rests.append(session)
    beside = [
        f"{_own(each.beside.own, d.verdict.names)} in {session}"
        for session, d, each in zip(sessions, diagnoses, effect.each, strict=True)
        if each.beside.own != ()
    ]
    also = f" Beside it acts {'; '.join(beside)}." if beside else ""
    if lacks:
        text = f"Undecided. Most likely the sessions share {_words(effect.names)}, but it does not stand.{also}"
        return PooledVerdict("undecided", effect.names, probability, text, tuple(lacks), tuple(rests))
    text = f"Found in all sessions together: {_words(effect.names)}, {_sizes(effect)}.{also}"
    return PooledVerdict("found", effect.names, probability, text, (), tuple(rests))


def _own(names: tuple[str, ...] | None, named: Sequence[str]) -> str:
    """What acts in one session alone; only perhaps, where its own diagnosis does not name it."""
    if names is None:
        return "something that no effect here describes"
    return _words(names) if set(names) <= set(named) else f"perhaps {_words(names)}"


def _sizes(effect: SharedEffect) -> str:
    one = "of one size in all sessions, as a fault of the rig would be"
    own = "of another size in each session, as what belongs to a specimen would be"
    if effect.shared:
        return one
    if not effect.same:
        return own
    return f"{_words(effect.same)} {one}; the other {own}"


def _thin(diagnoses: Sequence[Diagnosis]) -> list[str]:
    """What a finding lacks where there is little to find it in, or nothing to test it with."""
    roles = [d.problem.observations.roles for d in diagnoses]
    cases = sum(r.count("identification") for r in roles)
    if cases < LEAST_CASES * len(diagnoses) // 2:
        return [f"{cases} identification cases in {len(diagnoses)} sessions are too few to decide anything"]
    return [] if any("validation" in r for r in roles) else [UNTESTED]


def _unbelievable(
    sessions: Sequence[str], diagnoses: Sequence[Diagnosis], effect: SharedEffect, stands: Sequence[int]
) -> list[str]:
    """What a finding lacks because of its values, or of the cases that were never fitted."""
    out = []
    sizes = [("all sessions", effect.value, effect.sd)] if effect.shared else []
    sizes += [(sessions[k], effect.each[k].values, effect.each[k].sd) for k in stands if not effect.shared]
    for where, values, sds in sizes:
        for parameter, value, sd in zip(effect.parameters, values, np.nan_to_num(sds), strict=True):
            if not believable(parameter, float(value), float(sd)):
                out.append(f"{parameter.name} of {where} lies outside what is plausible")
    errors = [_held_out(d, each) for d, each in zip(diagnoses, effect.each, strict=True)]
    tested = [e for e in errors if e is not None]
    if tested:
        before, after = np.sqrt(np.mean(np.square(tested), axis=0))
        if rises(before, after, float(np.median([typical_sd(d.problem) for d in diagnoses]))):
            out.append(f"the error of the cases never fitted rises from {before:.3f} to {after:.3f} N")
    return out


def _held_out(diagnosis: Diagnosis, each: InSession) -> tuple[float, float] | None:
    """RMSE [N] of one session's cases never fitted, without any effect and with what is shared and its own."""
    problem, fitted = diagnosis.problem, each.beside.weighed.fitted
    before = diagnosis.validation_rmse(diagnosis.evidence.nothing)
    after = validation_rmse(problem, compare(problem.model, problem.observations, fitted.theta))
    return None if before is None or after is None else (before, after)


def _each(sessions: Sequence[str], diagnoses: Sequence[Diagnosis]) -> str:
    """What each session says by itself, in words."""
    said: dict[str, list[str]] = {}
    for session, d in zip(sessions, diagnoses, strict=True):
        verdict = d.verdict
        what = {
            "found": f"{_words(verdict.names)} {'act' if len(verdict.names) > 1 else 'acts'}",
            "one_of": f"one of {', '.join(verdict.names)} acts",
            "none_of_catalogue": "something acts that no effect here describes",
            "nothing_missing": "nothing is missing",
            "undecided": "it is not decided",
        }[verdict.kind]
        said.setdefault(what, []).append(session)
    return "; ".join(f"in {_words(where)} {what}" for what, where in said.items())


def _words(names: Sequence[str]) -> str:
    names = list(names)
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
