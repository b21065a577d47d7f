"""What is done with a session: refit, diagnose, add, save. Values in, values out.

The package exports these functions: `from fingermodel import Session, compare, refit, diagnose, add, save`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from daq.errors import InputError, ModelError
from fingermodel.comparing import compare
from fingermodel.diagnosis.answer.addition import Addition, add_effects
from fingermodel.diagnosis.answer.answer import answer
from fingermodel.diagnosis.diagnose import diagnose as search
from fingermodel.diagnosis.next_cases.next_cases import plan_next
from fingermodel.fitting.eq5 import refit_slsqp
from fingermodel.fitting.fit_report import Fit
from fingermodel.fitting.problems import eq5_problem
from fingermodel.model_files import Step, require_new, revision_of
from fingermodel.revisions import save_revision
from fingermodel.session import Session, require_session

if TYPE_CHECKING:
    from fingermodel.diagnosis.diagnose import Diagnosis as Details
    from fingermodel.fingers import Plane
    from fingermodel.model_files import Revision

__all__ = ["Diagnosis", "add", "diagnose", "refit", "save"]

Progress = Callable[[float], None]
_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")
# Starts of the solver: enough to see whether other values fit as well, still about a second.
STARTS = 8


def _one_thread(function: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
    """Let linear algebra use one thread while a function runs, whatever has loaded NumPy before.

    The matrices of a session are too small to share: on a busy machine with two cores a diagnosis by two threads took
    thirteen times as long.
    """

    @wraps(function)
    def limited(*args: _Given.args, **kwargs: _Given.kwargs) -> _Result:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def _require_starts(starts: object) -> None:
    """Refuse a number of starts that is none."""
    if not isinstance(starts, Integral) or int(starts) < 1:
        raise InputError(f"starts {starts!r:.60}", "a whole number, 1 or more")


@_one_thread
def refit(
    session: Session,
    method: Literal["map", "slsqp"] = "map",
    *,
    plane: Plane | None = None,
    starts: int = STARTS,
    progress: Progress | None = None,
) -> Fit:
    """Identify the model's parameters from the identification cases; validation cases are never fitted.

    Args:
        session: with the model to refit, and the effects that were added to it.
        method: `map`, all parameters at once with priors; or `slsqp`, as published (Synek et al. 2019, Eq 5).
        plane: of the forces that count, `sagittal` or `space`; by default what the finger's axes can predict.
        starts: of the solver, for `map`.
        progress: of `map`, is told the fraction that is done.

    Raises:
        SessionError: no identification case, or a force channel that never changes.
        InputError: no such method or plane, or a plane with `slsqp`, which is posed in the sagittal plane.

    Example:
        >>> from fingermodel import Session, refit
        >>> fit = refit(Session.open("synek2019_HMEAN"))
        >>> fit.outcome
        'converged'
        >>> fit.parameters[0].unit
        'mm'
    """
    require_session(session)
    session.measured.require_forces()
    _require_starts(starts)
    if method not in ("map", "slsqp"):
        raise InputError(f"method {method!r}", "map or slsqp")
    if method == "slsqp":
        if plane is not None:
            raise InputError(f"plane {plane!r} with method 'slsqp'", "no plane", "Eq 5 is posed in the sagittal plane")
        return refit_slsqp(eq5_problem(session.model, session.observations))
    start = session.theta if session.refitted else None
    return add_effects(
        session.model,
        session.observations,
        (),
        plane=plane,
        held=session.loaded.added,
        start=start,
        starts=starts,
        progress=progress,
    ).fit


@_one_thread
def add(
    session: Session, *effects: str, without: Sequence[str] = (), starts: int = STARTS, progress: Progress | None = None
) -> Addition:
    """Add effects to a session's model, and refit everything together.

    Args:
        session: whose model holds the effects at their null values, as `Session.open` makes it.
        effects: names of effects (`hanger_mass`), of which the best form is taken, or candidates (`worn_pulley.FDP`).
        without: effects to take out that were added before.
        starts: of the solver.
        progress: is told the fraction that is done.

    Returns:
        the fit, the names of what was added, and how far it raises the log evidence [nat].

    Raises:
        ModelError: no such effect, or one that cannot act in this session.
        SessionError: as of `refit`.
        InputError: an effect is to be taken out that the model does not hold.

    Example:
        >>> from fingermodel import Session, add
        >>> addition = add(Session.open("DEV-02"), "hanger_mass")
        >>> mass = addition.fit.parameter("hanger_mass.m0")
        >>> f"{mass.value:.0f} {mass.unit}"
        '29 g'
    """
    require_session(session)
    session.measured.require_forces()
    _require_starts(starts)
    for name in effects:
        if not isinstance(name, str):
            raise InputError(f"effect {name!r:.60}", "names of effects, one after the other", "add(session, *names)")
    return add_effects(
        session.model,
        session.observations,
        effects,
        held=session.held_without(without),
        start=session.theta if session.refitted else None,
        starts=starts,
        progress=progress,
    )


@_one_thread
def diagnose(session: Session, *, thorough: bool = False, progress: Progress | None = None) -> Diagnosis:
    """Find out which effect is missing from a session's model, or that the data cannot tell.

    Args:
        session: whose model holds the candidates at their null values, as `Session.open` makes it. Effects that were
            added to it are part of the base model.
        thorough: whether to fit three times as many explanations.
        progress: is told the fraction that is done.

    Raises:
        SessionError: no identification case, or a force channel that never changes.

    Example:
        >>> from fingermodel import Session, diagnose
        >>> diagnosis = diagnose(Session.open("DEV-02"))
        >>> diagnosis.verdict, diagnosis.found
        ('found', ('hanger_mass',))
        >>> before, after = diagnosis.rmse_N("validation/tip")
        >>> after < before / 2
        True
    """
    require_session(session)
    session.measured.require_forces()
    return Diagnosis(
        search(
            session.model,
            session.observations,
            held=session.loaded.added,
            start=session.theta if session.refitted else None,
            thorough=thorough,
            progress=progress,
        )
    )


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis:
    """What is missing from a session's model.

    Attributes:
        details: fits, posterior and checks that the answer is made of.
    """

    details: Details = field(repr=False)

    def __str__(self) -> str:
        return self.sentence

    def __repr__(self) -> str:
        said = self.details.verdict
        return f"<Diagnosis: {' '.join((said.kind, *said.names))}, probability {min(said.probability, 1.0):.2f}>"

    @cached_property
    @_one_thread
    def answer(self) -> Mapping[str, Any]:
        """Everything that is known, as `fingertwin diagnose --json` gives it: plain values, units in the names."""
        return answer(self.details)

    @property
    def verdict(self) -> str:
        """`found`, `one_of`, `none_of_catalogue`, `nothing_missing` or `undecided`."""
        return str(self.answer["verdict"])

    @property
    def sentence(self) -> str:
        """The verdict in words, with the size of the effect."""
        return str(self.answer["sentence"])

    @property
    def probability(self) -> float:
        """Of the verdict."""
        return float(self.answer["probability"])

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that the verdict names: all that act for `found`, those in question for `one_of`."""
        return tuple(self.answer["effects"])

    @property
    def found(self) -> tuple[str, ...]:
        """Candidates that were found, such as `worn_pulley.FDP`, as `add` takes them; none for any other verdict."""
        return tuple(self.answer["candidates"]) if self.verdict == "found" else ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """What the verdict rests on, and what was short of a stronger one."""
        return tuple(self.answer["reasons"])

    @property
    def suspects(self) -> tuple[dict[str, Any], ...]:
        """Load cases that are more probably bad than not, the likeliest first; the verdict stands without them."""
        return tuple(self.answer["suspects"])

    @property
    def parameters(self) -> tuple[dict[str, Any], ...]:
        """Sizes of the most probable explanation's parameters: name, value, sd, unit."""
        return tuple(self.answer["ranking"][0]["parameters"])

    def rmse_N(self, group: str) -> tuple[float, float]:  # noqa: N802 - N is the unit
        """Return the root mean square error [N] of a group of load cases, refitted without and with what is missing.

        Args:
            group: `role/location`, such as `validation/tip`.

        Raises:
            InputError: there is no such group.
        """
        if group not in self.answer["before"]:
            raise InputError(f"no load case of {group}", f"one of {', '.join(self.answer['before'])}")
        plane = self.details.session.model.finger.judged_in
        before, after = (float(self.answer[key][group][plane]["rmse_N"]) for key in ("before", "after"))
        return before, after

    def table(self) -> dict[str, list[Any]]:
        """Return the explanations by column, the most probable first; `pandas.DataFrame` takes it as it is."""
        rows = self.answer["ranking"]
        return {
            "explanation": [" + ".join(r["candidates"] or r["effects"]) or "nothing missing" for r in rows],
            "probability": [r["probability"] for r in rows],
            "log_evidence_gain_nat": [r["log_evidence_gain"] for r in rows],
            "validation_rmse_before_N": [r["validation_rmse_N"]["before"] for r in rows],
            "validation_rmse_after_N": [r["validation_rmse_N"]["after"] for r in rows],
        }

    @_one_thread
    def next_cases(self) -> list[dict[str, Any]]:
        """Plan the load cases that would tell most: posture, location, masses [g], expected information [nat]."""
        return [case.as_dict() for case in plan_next(self.details).cases]


def save(session: Session, fit: Fit | Addition, path: str | os.PathLike[str]) -> Revision:
    """Write a fit as a revision, which `Session.open(…, model=path)` and `fingertwin compare --model` take.

    Args:
        session: that was fitted.
        fit: of `refit` or `add`.
        path: of a new `.json` file.

    Raises:
        ModelError: the file exists, and revisions are never overwritten; its name does not end in `.json`; or the fit
            is of another session.
    """
    target, step = Path(path), None
    require_new(target)
    result = fit.fit if isinstance(fit, Addition) else fit
    if result.session != session.id:
        found = f"a fit of session {result.session} to be saved as one of {session.id}"
        raise ModelError(found, "the session that was fitted", f"Give session {result.session}")
    if isinstance(fit, Addition):
        freed = {p.name for p in fit.fit.parameters}
        kept = [name for name in session.loaded.added if name in freed]
        removed = {name.split(".")[0] for name in session.loaded.added} - {name.split(".")[0] for name in kept}
        # A refit without the effect, so that its share of the fall is not taken for the effect's.
        plain = refit(session.holding(kept)) if fit.names else None
        alone = compare(session.at(plain)).without(plain.errors.not_counted).summary() if plain else None
        evidence = {"log_evidence_gain": fit.log_evidence_gain}
        step = Step(added=fit.names, removed=tuple(sorted(removed)), evidence=evidence, alone=alone)
    apart = result.errors.not_counted
    before, after = (compare(s).without(apart).summary() for s in (session, session.at(fit)))
    document = save_revision(session, result, target, before, after, step)
    return revision_of(document, target.name)
