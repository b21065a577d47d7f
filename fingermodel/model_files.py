"""A fitted model as a file: a revision (`fingertwin-model/1`) with its parent, that `compare --model` takes.

A revision holds the whole finger, so it stands without the file it came from, and every fitted parameter with its
uncertainty. Errors of the rig (the budget) belong to the session they were fitted on; on another session they are
left at zero.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.documents import EACH_ONCE, RepeatedNameError, unique_keys
from daq.errors import ModelError
from daq.files import replacing
from daq.measured import MeasuredSession
from fingermodel.budget import Budget, budget_of
from fingermodel.effects import catalogue
from fingermodel.effects.user import effect_from_dict
from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_document, finger_from_dict, read_finger
from fingermodel.fitting.fit_report import Fit
from fingermodel.model import Model
from fingermodel.stages import Effect, Layout

FORMAT = "fingertwin-model/1"
# How a model's fit stands to the session that it is held against.
_FITTED, _CHANGED = "fitted to these readings", "fitted to this session before it was changed"
_ELSEWHERE = "not refitted to these readings"


@dataclass(frozen=True, eq=False)
class Revision:
    """One state of a specimen's model.

    Attributes:
        id: unique name of the revision.
        parent: of the revision or finger that it was fitted from.
        session: id of the session that it was fitted to.
        finger: with the fitted anatomy.
        prior: finger about which the priors of the fit stood.
        theta: (name → value) of every parameter that was free.
        document: the whole file.
    """

    id: str
    parent: str
    session: str
    finger: Finger
    prior: Finger
    theta: dict[str, float]
    document: dict[str, Any]

    @property
    def effects(self) -> dict[str, float]:
        """Parameters of the effects that it holds, by name, each in its own unit."""
        held = self.document.get("effects") or []
        return {name: self.theta[name] for effect in held for name in effect["parameters"] if name in self.theta}


@dataclass(frozen=True)
class Step:
    """How a revision differs from its parent.

    Attributes:
        effects: every effect that the model now holds: `{"name", "parameters", "document"}`, the last for the user's
            own effects.
        added: names of candidates added in this step.
        removed: and taken out.
        evidence: what spoke for it, such as its gain in log evidence.
        alone: summary of errors of a refit without what is added, so that nobody takes its share for the effect's.
        history: of the revisions before, oldest first.
    """

    effects: tuple[dict[str, Any], ...] = ()
    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    evidence: dict[str, Any] | None = None
    alone: Mapping[str, Any] | None = None
    history: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True, eq=False)
class LoadedModel:
    """A model ready for one session: parameters, and what had to be left out to make it fit.

    `added` names the parameters of the effects that earlier revisions added, `history` tells those revisions in turn,
    and `fit` how it stands to the session's readings.
    """

    name: str
    model: Model
    theta: NDArray[np.float64]
    parent: str
    notes: tuple[str, ...]
    added: tuple[str, ...] = ()
    history: tuple[dict[str, Any], ...] = ()
    fit: str = _FITTED

    @property
    def fitted(self) -> str:
        """After which fit residuals of this model are, in words."""
        if self.name == self.model.finger.id:
            return f"{self.name} as its file has it, before any refit"
        return f"{self.name}, {self.fit}"

    @property
    def outdated(self) -> bool:
        """Whether it was fitted to the session before that was changed."""
        return self.fit == _CHANGED

    def refitted(
        self, name: str, theta: NDArray[np.float64], added: tuple[str, ...], other: str | None = None
    ) -> LoadedModel:
        """Return the model at a fit to the session's readings, or to those of another one."""
        notes = () if other is None else (of_another(other, added),)
        fit = _FITTED if other is None else _ELSEWHERE
        return replace(self, name=name, theta=theta, added=added, notes=notes, fit=fit)


def revision_document(
    fit: Fit,
    parent: str,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    readings_sha256: str | None,
    note: str = "",
    step: Step | None = None,
    measured_sha256: str | None = None,
) -> dict[str, Any]:
    """Describe a fit as a revision.

    Args:
        fit: with the model and the session that it is of.
        parent: id of the finger or revision that the fit started from.
        before: summary of errors before the fit.
        after: and after it.
        readings_sha256: of the readings file, None for averaged forces.
        note: anything to keep with it.
        step: which effects it holds, what changed, and on what evidence; by default none.
        measured_sha256: `MeasuredSession.sha256` of what was fitted, by which a later change of it is noticed.
    """
    step, model, session = step or Step(), fit.model, fit.session
    free = np.flatnonzero(fit.free)
    names = [model.parameters.names[i] for i in free]
    body: dict[str, Any] = {
        "format": FORMAT,
        "parent": parent,
        "session": {"id": session, "readings_sha256": readings_sha256, "measured_sha256": measured_sha256},
        "method": fit.method,
        "outcome": fit.outcome,
        "message": fit.message,
        "objective": fit.objective,
        "objective_before": fit.objective_before,
        "reading_errors": asdict(fit.errors),
        "effects": list(step.effects),
        "added": list(step.added),
        "removed": list(step.removed),
        "evidence": step.evidence,
        "budget": model.budget.as_dict(),
        "layout": {
            "settings": [list(s) for s in model.layout.settings],
            "mountings": [list(m) for m in model.layout.mountings],
        },
        "parameters": [asdict(p) for p in fit.parameters],
        "covariance": {
            "names": names,
            # Six digits hold more than any reading knows.
            "upper_rows": [[float(f"{x:.6g}") for x in fit.covariance[i, free[k:]]] for k, i in enumerate(free)],
        },
        "before": dict(before),
        "after": dict(after),
        "note": note,
    }
    values = model.values_at(fit.theta)
    fitted = model.finger.replace_values(**values._asdict())
    body["prior_finger"] = finger_document(model.finger, "fit", "an earlier fit", "fitted")
    cite = f"fitted to session {session} by {fit.method}"
    body["finger"] = finger_document(fitted, "fit", cite, "fitted")
    digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()[:12]
    created = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    identity = {"format": FORMAT, "id": f"{session}-{digest}", "created_utc": created}
    plane = model.finger.judged_in
    history = list(step.history) or [_told(parent, None, None, _rmse(before, plane))]
    gain = (step.evidence or {}).get("log_evidence_gain")
    alone = None if step.alone is None else _rmse(step.alone, plane)
    if alone is not None and _differ(alone, history[-1]["rmse_N"]):
        history.append(_told(None, parent, None, alone, removed=step.removed))
    # What the refit in between took out already is no change of this step.
    history.append(_told(identity["id"], parent, created, _rmse(after, plane), step.added, step.removed, gain))
    return identity | body | {"history": history}


def _told(
    name: str | None,
    parent: str | None,
    created: str | None,
    rmse_N: Mapping[str, float | None],
    added: Sequence[str] = (),
    removed: Sequence[str] = (),
    gain: float | None = None,
) -> dict[str, Any]:
    """One step of a model's history; a refit that was kept nowhere has no id."""
    return {
        "id": name,
        "parent": parent,
        "created_utc": created,
        "added": list(added),
        "removed": list(removed),
        "log_evidence_gain": gain,
        "rmse_N": dict(rmse_N),
    }


def _differ(a: Mapping[str, float | None], b: Mapping[str, float | None]) -> bool:
    """Whether errors differ by a printed digit."""
    return any(abs((a[place] or 0.0) - (b.get(place) or 0.0)) >= 5e-4 for place in a)


def _rmse(summary: Mapping[str, Any], plane: str) -> dict[str, float | None]:
    return {place: planes[plane]["rmse_N"] for place, planes in summary.items()}


def require_new(path: Path) -> None:
    """Refuse to write a revision where there is a file, or under a name by which none is known.

    Raises:
        ModelError: the file exists, or does not end in `.json`.
    """
    if path.suffix != ".json":
        remedy = f"Call it {path.name}.json"
        raise ModelError(f"{path} is no name of a revision", "a file whose name ends in .json", remedy)
    if path.exists():
        raise ModelError(f"{path} exists", "a new file: revisions are never overwritten", "Choose another --out")


def write_revision(document: Mapping[str, Any], path: Path) -> None:
    """Write a revision; an existing file is never overwritten.

    Raises:
        ModelError: the file exists, or does not end in `.json`.
    """
    require_new(path)
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def free_path(folder: Path, session: str) -> Path:
    """Return the first `SESSION-rN.json` in a folder that is not taken."""
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", session) or "session"
    number = 1
    while (path := folder / f"{safe}-r{number}.json").exists():
        number += 1
    return path


def read_revision(file: str | os.PathLike[str]) -> Revision:
    """Read a revision.

    Args:
        file: its path.

    Raises:
        ModelError: no such file, not a revision, or a damaged one.
    """
    path = Path(file)
    if not path.is_file():
        raise ModelError(f"no model file {path}", "a revision written by `fingertwin refit --out`")
    try:
        document = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=unique_keys)
    except RepeatedNameError as error:
        raise ModelError(f"{path.name}: {error}", *EACH_ONCE) from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ModelError(
            f"{path.name} is not JSON ({error})", f"{FORMAT}, as `fingertwin refit --out` writes"
        ) from error
    return revision_of(document, path.name)


def revision_of(document: object, name: str) -> Revision:
    """Make a revision of its document.

    Args:
        document: the whole of it, as `revision_document` made it.
        name: of the file or place that it comes from, for messages.

    Raises:
        ModelError: not a revision, or a damaged one.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        found = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise ModelError(f"{name} has format {found!r}", f"{FORMAT}, as `fingertwin refit --out` writes")
    try:
        return Revision(
            id=str(document["id"]),
            parent=str(document["parent"]),
            session=str(document["session"]["id"]),
            finger=finger_from_dict(document["finger"], name),
            prior=finger_from_dict(document["prior_finger"], name),
            theta={str(p["name"]): float(p["value"]) for p in document["parameters"]},
            document=document,
        )
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{name} lacks or damages {error}", f"a whole {FORMAT} file", "Fit again") from error


def load_model(
    name: str | os.PathLike[str] | Finger | Revision | None,
    session_id: str,
    finger_name: str,
    folder: Path | None,
    layout: Layout,
    budget: Budget,
    effects: tuple[Effect, ...] = (),
    measured: MeasuredSession | None = None,
) -> LoadedModel:
    """Load what `--model` names (a revision, a finger file, a shipped finger) for one session.

    Args:
        name: of the model, or the model itself; None takes the session's own finger.
        session_id: of the session.
        finger_name: that the session names.
        folder: of the session.
        layout: of the session.
        budget: of the session.
        effects: that the model shall hold at their null, such as the catalogue; a revision with effects of its own
            holds the whole catalogue anyway, so that all share one compiled program.
        measured: the session, by which a revision is known that was fitted before a change; None where nothing is yet.
    """
    if isinstance(name, str | os.PathLike) and Path(name).suffix == ".json":
        name = read_revision(name)
    if isinstance(name, Revision):
        return _from_revision(name, session_id, layout, effects, measured)
    if isinstance(name, Finger):
        finger = name
    else:
        finger = read_finger(finger_name, folder) if name is None else read_finger(name)
    model = Model(finger, layout, budget, effects)
    return LoadedModel(finger.id, model, model.initial, finger.id, ())


def _from_revision(
    revision: Revision,
    session_id: str,
    layout: Layout,
    effects: tuple[Effect, ...],
    measured: MeasuredSession | None,
) -> LoadedModel:
    settings = {k: v for k, v in revision.document["budget"].items() if k != "name"}
    held = revision.document.get("effects") or []
    if held:
        # What the revision holds under the name of a shipped effect is its own.
        names = {e["name"] for e in held}
        given = [e for e in effects if e not in catalogue.CATALOGUE and not (e.outside and e.name in names)]
        own = [effect_from_dict(e["document"], revision.id, given) for e in held if e.get("document")]
        for effect in given:
            if any(o.name == effect.name and o != effect for o in own):
                raise ModelError(
                    f"{revision.id} holds another effect of the name {effect.name} than the one given",
                    "one effect of a name",
                    "Rename yours, or leave out its --effect",
                )
        effects = (*catalogue.CATALOGUE, *dict.fromkeys([*given, *own]))
    # The priors stay where they stood, so that fitting again does not count the same readings twice.
    model = Model(revision.prior, layout, budget_of(settings), effects)
    same = revision.session == session_id
    theta = model.initial
    anatomy = Model(revision.finger, layout, model.budget).initial
    shared = np.flatnonzero(model.parameters.of_kind("anatomy"))
    theta[shared] = anatomy[: len(shared)]
    take_over(revision.theta, model, theta, same=same)
    added = tuple(n for e in held for n in e["parameters"] if n in model.parameters.index)
    history = tuple(revision.document.get("history") or ())
    notes, fit = tuple[str, ...](), _FITTED
    if not same:
        notes, fit = (of_another(revision.session, added),), _ELSEWHERE
    # Revisions of earlier versions do not say what they were fitted to.
    elif measured is not None and revision.document["session"].get("measured_sha256") not in (None, measured.sha256):
        notes, fit = (f"{revision.id} was {_CHANGED}: only a refit takes the change in",), _CHANGED
    return LoadedModel(revision.id, model, theta, revision.id, notes, added, history, fit)


def take_over(values: Mapping[str, float], model: Model, theta: NDArray[np.float64], *, same: bool) -> None:
    """Put fitted values into a model's parameter vector, by name; what the model lacks is left out.

    Args:
        values: by name of the parameter.
        model: that takes them.
        theta: (parameters,) of it, which is changed.
        same: whether they were fitted to this session; another's errors of the rig are left out.
    """
    for i, parameter in enumerate(model.parameters):
        if parameter.name in values and (same or parameter.kind != "budget"):
            theta[i] = values[parameter.name]


def of_another(session: str, added: Sequence[str]) -> str:
    """Say what a fit of another session is used for, and what not."""
    used = "its anatomy and its effects are used here, the small" if added else "its anatomy is used here, the"
    return f"fitted to session {session}: {used} errors of that rig are not"
