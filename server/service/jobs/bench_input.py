"""Input of a worker from a bench session: its description and its reduced windows, never its readings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from daq.checks import RecordingScan, warnings_of
from daq.errors import ModelError
from daq.measured import MeasuredSession
from daq.recordings.plateaus import Plateau
from daq.recordings.windows import Span
from daq.sessions import FINGER_DOCUMENT, parse_session
from daq.signals.corrections import as_entered as measured_as_entered
from daq.signals.corrections import assemble
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.effects.user import effect_from_dict
from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_from_dict, finger_names, read_finger
from fingermodel.model_files import Revision, revision_of
from fingermodel.session import Session
from fingermodel.stages import Effect

__all__ = ["FINGER_DOCUMENT", "BenchInput"]


@dataclass(frozen=True, eq=False)
class BenchInput:
    """A measured session and the model to hold against it, as values that go from process to process."""

    # Document of a bench-session/1 whose cases are all measured; it may hold its finger (`finger_document`).
    session: Mapping[str, Any]
    plateaus: Mapping[Span, Plateau] = field(default_factory=dict)  # its windows, reduced
    notes: tuple[str, ...] = ()  # what the reader of the results should know
    # Document of a revision, name of a shipped finger, or None for the session's own finger.
    model: Mapping[str, Any] | str | None = None
    effects: tuple[Mapping[str, Any], ...] = ()  # documents of the user's own effects
    readings_sha256: str | None = None  # fingerprint of the readings that the windows were cut from
    # What the answer says that it came from; no part of the fingerprint.
    provenance: Mapping[str, Any] = field(default_factory=dict)
    scan: RecordingScan | None = None  # of its recording, for the warnings of the check

    @property
    def id(self) -> str:
        """Id of the session."""
        return str(self.session["id"])

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all that a result follows from."""
        said = [dict(self.session), self.model, [dict(e) for e in self.effects]]
        digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
        for window, plateau in sorted(self.plateaus.items()):
            digest.update(repr(window).encode())
            digest.update(plateau.mean.tobytes())
            digest.update(plateau.covariance.tobytes())
        return digest.hexdigest()

    def measured(self) -> MeasuredSession:
        """Put the forces of the load cases together.

        Raises:
            InputError: the session cannot be used.
        """
        session, faults = parse_session(dict(self.session), None)
        if session is None:
            raise faults[0]
        return assemble(session, self.plateaus, self.notes)

    def open(self, *, catalogue: bool = False, effects: Sequence[Effect] = (), as_entered: bool = False) -> Session:
        """Load the model and hold it against the session.

        Args:
            catalogue: whether the model shall hold the catalogue's effects, at their null.
            effects: more effects of the user's, which come with the catalogue.
            as_entered: whether amendments are passed over.

        Raises:
            InputError: session, model or effects cannot be used.
        """
        prepare_jax()
        own = [effect_from_dict(dict(document), "the session's own effect") for document in self.effects]
        measured = self.measured()
        if as_entered:
            measured = measured_as_entered(measured)
        bench = Session.of(measured, self._model(), catalogue=catalogue, effects=[*own, *effects])
        return replace(bench, findings=warnings_of(measured, self.plateaus, self.scan))

    def _model(self) -> Finger | Revision:
        """Return the model itself: no name in a document is ever taken for a path."""
        if isinstance(self.model, Mapping):
            return revision_of(dict(self.model), "the revision")
        if self.model is None and FINGER_DOCUMENT in self.session:
            return finger_from_dict(self.session[FINGER_DOCUMENT], "the session's finger")
        name = str(self.session["finger"]) if self.model is None else self.model
        known = finger_names()
        if name not in known:
            raise ModelError(f"no finger {name[:200]!r}", f"one of {', '.join(known)}")
        return read_finger(name)
