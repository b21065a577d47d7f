"""A measured bench session with the model that is compared with it: opened from a folder, refitted, saved.

This is the one module of the model that asks the bench to correct readings; everything below it takes records.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from daq.checks import measure_and_check
from daq.errors import InputError, ModelError, require_list
from daq.sessions import read_session
from daq.vocabulary import did_you_mean
from fingermodel.compiled.compilation import prepare_jax

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from daq.findings import Finding
    from daq.measured import MeasuredSession
    from fingermodel.comparison.observations import Observations
    from fingermodel.diagnosis.answer.addition import Addition
    from fingermodel.fingers import Finger
    from fingermodel.fitting.fit_report import Fit
    from fingermodel.model import Model
    from fingermodel.model_files import LoadedModel, Revision
    from fingermodel.stages import Effect

__all__ = ["Progress", "Session"]

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False, repr=False)
class Session:
    """A measured session with the model that is compared with it.

    A session is a value: nothing changes it. `at` returns another one, whose model stands at a fit.

    Attributes:
        measured: forces and torques per load case [N, N mm], corrected for tare, drift, mount and friction.
        observations: the same as arrays.
        loaded: the model, its parameters, and the revision that they come from.
        findings: errors and warnings of the session's check.

    Example:
        >>> from fingermodel import Session
        >>> session = Session.open("DEV-02")
        >>> session.id, session.model.finger.id, len(session.measured.cases)
        ('DEV-02', 'an1979_middle', 96)
    """

    measured: MeasuredSession
    observations: Observations
    loaded: LoadedModel
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        return f"<Session {self.id}: {len(self.observations.ids)} load cases, model {self.loaded.name}>"

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        model: str | os.PathLike[str] | Finger | Revision | None = None,
        *,
        effects: Sequence[Effect | str | os.PathLike[str]] = (),
        catalogue: bool = True,
        progress: Progress | None = None,
    ) -> Session:
        """Read a session, check it, correct its readings and load the model to compare with.

        Args:
            path: folder, `session.yaml`, or the name of a shipped session.
            model: a revision, a finger file or a shipped finger; by default the session's own finger.
            effects: the user's own, or their files; `diagnose` searches them with the catalogue.
            catalogue: whether the model holds the catalogue's effects, at their null values.
            progress: is told the fraction of the readings that has been read.

        Raises:
            InputError: a session, readings, a model or an effect that cannot be used.
        """
        prepare_jax()
        measured, findings = measure_and_check(read_session(os.fspath(path)), progress)
        return replace(cls.of(measured, model, effects=effects, catalogue=catalogue), findings=findings)

    @classmethod
    def of(
        cls,
        measured: MeasuredSession,
        model: str | os.PathLike[str] | Finger | Revision | None = None,
        *,
        effects: Sequence[Effect | str | os.PathLike[str]] = (),
        catalogue: bool = True,
    ) -> Session:
        """Load the model to compare a measured session with; arguments as of `open`.

        Raises:
            InputError: a model or an effect that cannot be used with this session.
        """
        prepare_jax()
        from fingermodel.budget import budget_of
        from fingermodel.comparison.observations import layout_of, observe
        from fingermodel.model_files import load_model

        session = measured.session
        # Readings that change within their windows have as far to go; a factor that was estimated is off a little.
        budget = budget_of(session.budget, measured.tension_case_sd).with_tension_sd(
            measured.creep, measured.tension_factor_rel_sd
        )
        held = held_effects(effects) if catalogue or effects else ()
        loaded = load_model(
            model, session.id, session.finger, session.folder, layout_of(measured), budget, held, measured
        )
        observations = observe(measured, loaded.model.finger, loaded.model.budget)
        return cls(measured, observations, loaded)

    @property
    def id(self) -> str:
        """Name of the session, such as `DEV-02`."""
        return self.measured.session.id

    @property
    def model(self) -> Model:
        """The model for the session's postures and mountings."""
        return self.loaded.model

    @property
    def theta(self) -> NDArray[np.float64]:
        """Its parameters (parameters,), before any further fit."""
        return self.loaded.theta

    @property
    def refitted(self) -> bool:
        """Whether the parameters come from a fit, not from the finger's file."""
        return self.loaded.name != self.model.finger.id

    def at(self, fit: Fit | Addition) -> Session:
        """Return the session with its model at a fit: parameters, and the effects that were added.

        A fit of another session must be of the same finger. Its anatomy and its effects belong to the specimen and are
        taken over; errors of its rig and its postures are not.

        Raises:
            ModelError: a fit of another finger, or with an effect that this session's model does not know.

        Example:
            >>> from fingermodel import Session, compare, refit
            >>> session = Session.open("synek2019_HMEAN")
            >>> better = session.at(refit(session))
            >>> bool(compare(better).rmse_N("validation/tip") < compare(session).rmse_N("validation/tip"))
            True
        """
        from fingermodel.fitting.fit_report import Fit
        from fingermodel.model_files import take_over

        result = fit if isinstance(fit, Fit) else fit.fit
        _require_fitting(result, self)
        theta, same = self.model.initial, result.session == self.id
        take_over(result.values, self.model, theta, same=same)
        freed = (p.name for p in result.parameters if p.kind == "effect")
        added = tuple(name for name in freed if name in self.model.parameters.index)
        name = f"{self.model.finger.id}, refitted"
        return replace(self, loaded=self.loaded.refitted(name, theta, added, None if same else result.session))

    def without(self, effects: Sequence[str]) -> Session:
        """Return the session with effects, candidates or parameters at their null; what was fitted beside them stays.

        Args:
            effects: names, such as `hanger_mass` or `worn_pulley.FDP`.

        Raises:
            InputError: a name that the model does not know, or one name instead of a list.
        """
        require_list(effects, "effects", "a list of effects or parameters")
        table, theta = self.model.parameters, self.theta.copy()
        # Every part of a dotted name, from its left, is a name by itself.
        parts = [name.split(".") for name in table.names]
        _require_known(effects, "effect or parameter", {".".join(p[:n]) for p in parts for n in range(1, len(p) + 1)})
        for name, i in table.index.items():
            if _belongs(name, effects):
                theta[i] = table.initial[i]
        return replace(self, loaded=replace(self.loaded, theta=theta))

    def at_values(self, values: Mapping[str, float]) -> Session:
        """Return the session with parameters by name, the others as its finger has them.

        Args:
            values: by name of the parameter.

        Raises:
            InputError: a name that is no parameter of the model.
        """
        table, theta = self.model.parameters, self.model.initial
        _require_known(values, "parameter", table.names)
        for name, value in values.items():
            theta[table.index[name]] = value
        return replace(self, loaded=replace(self.loaded, theta=theta))

    def holding(self, parameters: Sequence[str]) -> Session:
        """Return the session whose model was given these parameters of effects and no others: a refit frees them.

        Args:
            parameters: names, such as `hanger_mass.m0`.

        Raises:
            InputError: a name that is no parameter of the model, or one name instead of a list.
        """
        require_list(parameters, "parameters", "a list of parameters")
        _require_known(parameters, "parameter", self.model.parameters.names)
        return replace(self, loaded=replace(self.loaded, added=tuple(parameters)))

    def held_without(self, effects: Sequence[str] = ()) -> tuple[str, ...]:
        """Names of the parameters of effects that the model was given, without those of some effects.

        Args:
            effects: to be taken out.

        Raises:
            InputError: an effect is to be taken out that the model does not hold, or one name instead of a list.
        """
        require_list(effects, "without", "a list of effects")
        added = self.loaded.added
        unknown = [name for name in effects if not any(_belongs(p, [name]) for p in added)]
        if unknown:
            has = ", ".join(sorted({p.split(".")[0] for p in added}))
            expected = f"one of {has}" if has else "a model with an effect: this one has none"
            raise InputError(f"the model has no {unknown[0]} to take out", expected)
        return tuple(p for p in added if not _belongs(p, effects))


def _require_fitting(fit: Fit, session: Session) -> None:
    """Refuse a fit that says nothing of a session: of another finger, or with an effect that its model lacks."""
    theirs, ours = fit.model.finger, session.model.finger
    if not theirs.is_built_as(ours):
        raise ModelError(
            f"a fit of finger {theirs.id} for session {session.id} with finger {ours.id}",
            "a fit of the same finger",
            "Save it, and open the session with that revision as its model",
        )
    known = {effect.name for effect in session.model.effects}
    lacking = [p.name for p in fit.parameters if p.kind == "effect" and p.name.split(".")[0] not in known]
    if lacking:
        raise ModelError(
            f"a fit with {lacking[0]}, which the model of session {session.id} does not know",
            "a session whose model has the same effects",
            "Open it with the same effects and catalogue",
        )


def _require_known(names: Iterable[str], what: str, known: Collection[str]) -> None:
    """Refuse a name that is none of the known ones."""
    for name in names:
        if name not in known:
            expected = f"the name of one that it holds, such as {min(known)}" if known else "a model with one"
            raise InputError(f"the model has no {what} {name!r:.60}", expected, did_you_mean(name, sorted(known)))


def _belongs(parameter: str, effects: Sequence[str]) -> bool:
    """Whether a parameter is one of these, or belongs to one of these effects or candidates."""
    return any(parameter == name or parameter.startswith(f"{name}.") for name in effects)


def require_session(given: object) -> None:
    """Refuse what is no session, such as the name of one.

    Raises:
        InputError: it is none.
    """
    if not isinstance(given, Session):
        raise InputError(f"session {given!r:.60}", "an open session", "Open it: Session.open(…)")


def held_effects(own: Sequence[Effect | str | os.PathLike[str]] = ()) -> tuple[Effect, ...]:
    """The catalogue, effects of the user's or those in their files, and what rigs are known to do beyond both.

    What the user gives is found by its name; the rest is only ever something outside the catalogue.

    Raises:
        InputError: an effect that cannot be used, or one name or path where a list of them is expected.
    """
    from fingermodel.effects.catalogue import CATALOGUE
    from fingermodel.effects.user import load_effect, shipped_effects
    from fingermodel.stages import Effect

    require_list(own, "effects", "a list of effects or of their files")
    loaded = [load_effect(e) if isinstance(e, str | os.PathLike) else e for e in own]
    for effect in loaded:
        if not isinstance(effect, Effect):
            raise InputError(f"effect {effect!r:.60}", "an Effect, or the file of one")
    given = [replace(e, outside=False) if e.outside and is_dataclass(e) else e for e in loaded]
    taken = {e.name for e in given}
    beyond = [load_effect(Path(name)) for name in shipped_effects() if name not in taken]
    return (*CATALOGUE, *dict.fromkeys(given), *beyond)


def readings_digest(measured: MeasuredSession) -> str | None:
    """SHA-256 of the session's readings file, None for averaged forces."""
    path = measured.session.readings_path
    return None if path is None else sha256_of(path)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
