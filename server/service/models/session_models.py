"""Sessions held against models: the benches and comparisons that every answer of the service is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any

from sqlalchemy import select

from daq.sessions import FINGER_DOCUMENT
from fingermodel.comparing import compare
from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_from_dict, read_finger
from fingermodel.model_files import Revision
from fingermodel.predicting import Predictor
from fingermodel.session import Session
from fingermodel.stages import Effect
from server.application.provenance import provenance
from server.service.answers import Tagged
from server.service.ingest.stored import in_stream, known_stream
from server.service.models.effects import OwnEffects
from server.service.models.revisions import Revisions
from server.service.models.search_fits import asked, fit_revision
from server.service.sessions.blinding import seen
from server.service.sessions.measuring import Measured, Measuring
from server.service.sessions.records import Record
from server.service.sessions.turns import Made
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database
from server.service.storage.schema import chunks
from server.service.web.problems import ProblemError, shortened

_MOST_BENCHES, _MOST_COMPARISONS = 32, 256
# Of `model`: the revision in force for the session's specimen, or the session's own finger where there is none.
IN_FORCE = "in_force"


class SessionModels:
    """Holds sessions against models, each pair once.

    Args:
        database: that holds the readings.
        measuring: gives measured forces.
        revisions: that may be asked for as models.
        effects: of the users, which a search may have fitted.
        fingers: names of the fingers that come with the software.
    """

    def __init__(
        self,
        database: Database,
        measuring: Measuring,
        revisions: Revisions,
        effects: OwnEffects,
        fingers: frozenset[str],
    ) -> None:
        self._database, self._measuring, self._revisions = database, measuring, revisions
        self._effects, self._fingers = effects, fingers
        self._fits: Made[Revision] = Made(_MOST_BENCHES)
        self._benches: Made[Session] = Made(_MOST_BENCHES)
        self._compared: Made[Tagged] = Made(_MOST_COMPARISONS)
        self._predictors: Made[Predictor] = Made(_MOST_BENCHES)

    def model(self, name: str | None, measured: Measured | None = None) -> Revision | Finger | str | None:
        """Return the model that a request names.

        Args:
            name: of a revision, of a search's refit, of a finger that comes with the software or with the session,
                IN_FORCE, or None for the session's own.
            measured: the session.

        Raises:
            ProblemError: 422 there is no such model.
        """
        name = self._resolved(name, measured)
        if name is None:
            return None if measured is None else self._own_finger(measured)
        if name in self._fingers:
            return name
        if measured is not None and "/" in name:
            return self._search_fit(name, measured)
        try:
            return self._revisions.loaded(name)
        except ProblemError as error:
            if error.status != 404:
                raise
            raise ProblemError(
                422, f"there is no model {shortened(name)!r}", "a revision's id, or a finger of GET /api/v1/fingers"
            ) from None

    def _resolved(self, name: str | None, measured: Measured | None) -> str | None:
        """Return the name of a model, IN_FORCE resolved; None for the finger that a session brings with it."""
        if name is None or measured is None:
            return name
        if name == IN_FORCE and measured.session is not None:
            return self._revisions.in_force(measured.session.specimen.id)
        brought = (measured.record.document or {}).get(FINGER_DOCUMENT)
        return None if isinstance(brought, Mapping) and brought.get("id") == name else name

    def found(self, name: str | None, measured: Measured) -> dict[str, float]:
        """Return the values that a search gives with an explanation, by parameter; none for any other model."""
        if name is None or "/" not in name:
            return {}
        _, row = asked(self._database, name, measured.record.id)
        return {p["name"]: p["value"] for p in row["parameters"]}

    def _search_fit(self, name: str, measured: Measured) -> Revision:
        def made() -> Revision:
            answer, found = asked(self._database, name, measured.record.id)
            names = {c.split(".")[0] for c in found["candidates"]}
            bench = self.bench(measured, str(answer.get("model")), [e for e in self._effects.all() if e.name in names])
            return fit_revision(bench, name, answer, found)

        return self._fits.of((measured.key, name), made)

    def bench(self, measured: Measured, model: str | None = None, effects: Sequence[Effect] | None = None) -> Session:
        """Hold a session against a model.

        Args:
            measured: the session.
            model: as in `model`.
            effects: of the user's own that the model shall hold beside the catalogue, at their null; None leaves out
                the catalogue as well.

        Raises:
            InputError: the session or the model cannot be used.
            ProblemError: there is no such model.
        """
        forces = measured.require()
        found = self.model(model, measured)
        named = found if found is None or isinstance(found, str) else found.id
        key = (measured.key, named, None if effects is None else tuple(effects))

        def made() -> Session:
            session = Session.of(forces, found, catalogue=effects is not None, effects=effects or ())
            return replace(session, findings=measured.findings)

        return self._benches.of(key, made)

    def predictor(self, model: str) -> Predictor:
        """Return what predicts with a finger or revision.

        Raises:
            ProblemError: there is no such model.
        """

        def made() -> Predictor:
            found = self.model(model)
            return Predictor(read_finger(model) if found is None or isinstance(found, str) else found)

        return self._predictors.of(model, made)

    def comparison(self, name: str, model: str | None = None) -> Tagged:
        """Compare a session with a model; predictions of validation cases are left out while a bench is running.

        Raises:
            InputError: the session or the model cannot be used.
            ProblemError: there is no such session or model.
        """
        measured = self._measuring.of(name)
        asked = self._resolved(model, measured)

        def made() -> Tagged:
            bench, states = self.bench(measured, asked), measured.states
            whole = compare(bench)
            shown = seen(measured, whole)
            blinded = [] if measured.record.closed else [c.id for c in whole.cases if c.role == "validation"]
            rest = {s: {i: c.why for i, c in states.items() if c.state == s} for s in ("waiting", "failed", "excluded")}
            body = {"schema": "fingertwin/compare/1"} | provenance(bench) | shown.as_dict() | rest
            return Tagged.of(body | {"blinded": blinded, "provenance": self.provenance(measured, bench)})

        return self._compared.of((measured.key, asked), made)

    def provenance(self, measured: Measured, bench: Session, *, digest: bool = False) -> dict[str, Any]:
        """Say which readings, corrections, model and software a number came from.

        Args:
            measured: the session.
            bench: held against the model.
            digest: whether the readings are to be named by a digest of their chunks, which takes a moment.
        """
        record = measured.record
        return {
            "session": record.id,
            "session_version": record.version,
            "readings": self.readings_of(record, digest=digest),
            "edits": [e.number for e in record.edits],
            "model": bench.loaded.name,
            "model_parent": bench.loaded.parent,
            "tension_factor": measured.require().tension_factor,
            "tension_factor_source": measured.require().tension_factor_source,
            "software": version("fingertwin"),
        }

    def readings_of(self, record: Record, *, digest: bool = False) -> dict[str, Any] | None:
        """Say which readings a session has, as `provenance` does; None where it has averaged forces."""
        session, stream = record.id, record.stream
        if stream is None:
            return None
        with self._database.reading() as connection:
            out: dict[str, Any] = {"stream": stream, "samples": known_stream(connection, session, stream).held}
            if digest:
                query = select(chunks.c.first_seq, chunks.c.sha256).where(in_stream(session, stream))
                rows = connection.execute(query.order_by(chunks.c.first_seq))
                out["sha256_of_chunks"] = digest_of("\n".join(f"{r.first_seq} {r.sha256}" for r in rows).encode())
        return out

    def _own_finger(self, measured: Measured) -> Finger | None:
        """Return the finger that a session brings with it; None where it names one that the service has."""
        document = measured.record.document or {}
        finger = document.get(FINGER_DOCUMENT)
        if finger is not None:
            return finger_from_dict(finger, f"the finger of {measured.record.id}")
        name = document.get("finger")
        if name not in self._fingers:
            raise ProblemError(
                422,
                f"session {measured.record.id} names finger {shortened(name)!r}, which is a file of the bench",
                f"one of {', '.join(sorted(self._fingers))}, or its document as {FINGER_DOCUMENT}",
                "Ask with ?model=",
            )
        return None
