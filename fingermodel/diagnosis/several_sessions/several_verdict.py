"""What may be said of several sessions together: what they share, that it is nothing, or that it is not settled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.session_model.candidates import Explanation
from fingermodel.diagnosis.settings import LEAST_CASES, LIVE, SURE
from fingermodel.diagnosis.verdict.verdict import Kind, words
from fingermodel.parameters import Parameter


@dataclass(frozen=True, eq=False)
class InSession:
    """What one session says of what is shared."""

    gain: float  # log evidence that it acts there, over what else may act, to the power to which it counts
    values: Floats  # (k,) of its parameters, in their units, by this session alone
    sd: Floats  # (k,) of them
    own: tuple[str, ...] | None  # candidates that act beside it there alone; None is something unknown
    by_name: float  # probability that it acts there by its known law, if it acts
    size: Quadratic  # what the session says of its parameters, in prior widths


@dataclass(frozen=True, eq=False)
class SharedEffect:
    """Candidates that act in all sessions."""

    explanation: Explanation  # what is shared, as the first session has it
    parameters: tuple[Parameter, ...]  # of what is shared
    one_size: bool  # whether one size serves all sessions better than one in each
    value: Floats  # (k,) size by all sessions together, in the parameters' units
    sd: Floats  # (k,) of it
    # That it acts in all over that it acts in none, with one size for all; to the same power.
    log_evidence_shared: float
    log_evidence_own: float  # the same with a size for each session
    each: tuple[InSession, ...]  # by session
    probability: float = 0.0  # of this explanation among all pooled ones

    @property
    def names(self) -> tuple[str, ...]:
        """Of the candidates."""
        return self.explanation.names


@dataclass(frozen=True)
class PooledVerdict:
    """What the sessions say together, and why."""

    kind: Kind  # of the verdict
    names: tuple[str, ...]  # candidates that it names
    probability: float  # of the verdict
    sentence: str  # in plain words
    short: tuple[str, ...] = ()  # what was short of a stronger verdict
    # Sessions without which what is found would not be sure; none where nothing is found.
    rests_on: tuple[str, ...] = ()
    effect: SharedEffect | None = None  # that is found


def judge_together(
    sessions: Sequence[str],
    diagnoses: Sequence[Diagnosis],
    ranking: Sequence[SharedEffect],
    apart: tuple[float, float, float],
    rests_on: Sequence[str],
) -> PooledVerdict:
    """Read off what sessions share.

    Args:
        sessions: ids.
        diagnoses: of each by itself.
        ranking: what may be shared, best first.
        apart: probability that nothing is shared; of that, that nothing is missing in any, and that in each it is
            something outside the catalogue.
        rests_on: sessions without which what leads would not be sure.
    """
    p_apart, p_nothing, p_other = apart
    few = [s for s, d in zip(sessions, diagnoses, strict=True) if _cases(d) < LEAST_CASES]
    if few:
        text = f"Undecided: {words(few)} {'has' if len(few) == 1 else 'have'} fewer than {LEAST_CASES} cases."
        return PooledVerdict("undecided", (), p_apart, text)
    included: dict[str, float] = {}
    for effect in ranking:
        # Of a law that would have to be another in most sessions, none is found by its name.
        if np.median([s.by_name for s in effect.each]) >= 0.5:
            for name in effect.names:
                included[name] = included.get(name, 0.0) + effect.probability
    sure = tuple(name for name, p in included.items() if p >= SURE)
    exact = next((e for e in ranking if set(e.names) == set(sure)), None)
    if sure and exact is not None:
        beside = [f"{words(s.own)} in {name}" for name, s in zip(sessions, exact.each, strict=True) if s.own]
        also = f" Beside it acts {'; '.join(beside)}." if beside else ""
        other = [name for name, s in zip(sessions, exact.each, strict=True) if s.by_name < 0.5]
        but = f" In {words(other)} its law would have to be another." if other else ""
        p = min(included[n] for n in sure)
        text = f"Found in all sessions together: {words(sure)}, {_sizes(exact)}.{also}{but}"
        return PooledVerdict("found", sure, min(p, 1.0), text, (), tuple(rests_on), exact)
    if p_apart >= SURE:
        kinds = {d.verdict.kind for d in diagnoses}
        if kinds == {"nothing_missing"}:
            return PooledVerdict("nothing_missing", (), p_nothing, "Taken together, nothing is missing in any session.")
        if kinds == {"none_of_catalogue"}:
            text = "Something is missing in every session that no effect here describes."
            return PooledVerdict("none_of_catalogue", (), p_other, text)
        return PooledVerdict("undecided", (), p_apart, f"The sessions share no effect: {_each(sessions, diagnoses)}.")
    likely = max(included, key=lambda n: included[n], default=None)
    short = [f"they share nothing with a probability of {p_apart:.2f}"]
    short += [f"{likely} has {included[likely]:.2f}"] if likely is not None and included[likely] >= LIVE else []
    if ranking and not included.keys() >= set(ranking[0].names):
        short.append(f"the law of {words(ranking[0].names)} would have to be another in most of them")
    text = "Undecided: together the sessions single out no effect that they share."
    best = max(included.values(), default=0.0)
    return PooledVerdict("undecided", (), best, text, tuple(short))


def to_correct(sessions: Sequence[str], diagnoses: Sequence[Diagnosis]) -> PooledVerdict:
    """Ask for sessions with a fault of the whole session to be corrected first."""
    faults = {s: d.faults[0] for s, d in zip(sessions, diagnoses, strict=True) if d.faults}
    said = "; ".join(f"in {session} {fault.words}" for session, fault in faults.items())
    them = "them" if len(faults) > 1 else "it"
    text = f"Undecided: correct {words(list(faults))} first, or leave {them} out: {said}."
    return PooledVerdict("undecided", (), min(fault.probability for fault in faults.values()), text)


def _cases(d: Diagnosis) -> int:
    roles = d.session.observations.roles
    return sum(role == "identification" for role in roles)


def _sizes(effect: SharedEffect) -> str:
    of = effect.parameters[:3]
    if not effect.one_size:
        return "with a size of its own in each"
    return ", ".join(
        f"{p.name} = {v:.3g} ± {s:.2g} {p.unit if p.unit != '1' else ''}".strip()
        for p, v, s in zip(of, effect.value, effect.sd, strict=False)
    )


def _each(sessions: Sequence[str], diagnoses: Sequence[Diagnosis]) -> str:
    """What each session says by itself, in words."""
    said: dict[str, list[str]] = {}
    for session, d in zip(sessions, diagnoses, strict=True):
        verdict = d.verdict
        what = {
            "found": f"{words(verdict.names)} {'act' if len(verdict.names) > 1 else 'acts'}",
            "one_of": f"one of {', '.join(verdict.names)} acts",
            "none_of_catalogue": "something acts that no effect here describes",
            "nothing_missing": "nothing is missing",
            "undecided": "it is not decided",
        }[verdict.kind]
        said.setdefault(what, []).append(session)
    return "; ".join(f"in {words(where)} {what}" for what, where in said.items())
