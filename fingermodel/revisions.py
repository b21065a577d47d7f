"""Write a session's fit as a revision, with the effects that it holds and a note in the trail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.audit import note
from fingermodel.effects.catalogue import EFFECTS
from fingermodel.effects.user import effect_document
from fingermodel.model_files import Step, revision_document, write_revision
from fingermodel.session import readings_digest, sha256_of

if TYPE_CHECKING:
    from fingermodel.fitting.fit_report import Fit
    from fingermodel.session import Session


def save_revision(
    session: Session,
    fit: Fit,
    path: Path,
    before: dict[str, Any],
    after: dict[str, Any],
    step: Step | None = None,
) -> dict[str, Any]:
    """Write a fit as a revision and return its document."""
    document = describe_revision(session, fit, before, after, readings_digest(session.measured), step)
    write_revision(document, path)
    changed = {
        "file": path.name,
        "revision": document["id"],
        "added": document["added"],
        "removed": document["removed"],
    }
    note(path.parent, "add" if step else "refit", session.id, changed | {"sha256": sha256_of(path)})
    return document


def describe_revision(
    session: Session,
    fit: Fit,
    before: dict[str, Any],
    after: dict[str, Any],
    readings_sha256: str | None,
    step: Step | None = None,
) -> dict[str, Any]:
    """Return the document of a fit as a revision; effects and history of its step are filled in here."""
    free = [p.name for p in fit.parameters if p.kind == "effect"]
    step = replace(step or Step(), effects=held_by(session, free), history=session.loaded.history)
    return revision_document(
        fit,
        session.loaded.parent,
        before,
        after,
        readings_sha256,
        step=step,
        measured_sha256=session.measured.sha256,
    )


def held_by(session: Session, parameters: Sequence[str]) -> tuple[dict[str, Any], ...]:
    """Return the effects whose parameters are free, as a revision keeps them."""
    out = []
    for effect in session.model.effects:
        names = [p for p in parameters if p.split(".")[0] == effect.name]
        if names:
            document = None if effect.name in EFFECTS else effect_document(effect)
            out.append({"name": effect.name, "parameters": names, "document": document})
    return tuple(out)
