"""Revisions of a specimen's model: what was added and why, and how the error fell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fingertwin.client.exchange import Body, Exchange, path_of, reading
from fingertwin.client.figures import figure
from fingertwin.client.files import fetched, format_of
from fingertwin.client.summaries import Summary, made, names, rmse_of, summary_of

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class Step:
    """One step of a model's history.

    Attributes:
        id: of the finger or revision; None for the refit without what the next step adds, which is not kept.
        added, removed: effects.
        log_evidence_gain: of what was added; None for a mere refit.
        rmse_N: by `role/location`, in the plane that the finger is judged in.
    """

    id: str | None
    added: tuple[str, ...]
    removed: tuple[str, ...]
    log_evidence_gain: float | None
    rmse_N: Mapping[str, float | None]

    @property
    def change(self) -> str:
        """What the step did, in short."""
        return " ".join([*(f"+{a}" for a in self.added), *(f"−{r}" for r in self.removed)])

    @classmethod
    def of(cls, body: Body) -> Step:
        """Of plain data."""
        return cls(body["id"], names(body["added"]), names(body["removed"]), body["log_evidence_gain"], body["rmse_N"])


@dataclass(frozen=True, eq=False)
class Revision:
    """A state of a specimen's model; none is ever overwritten.

    Attributes:
        id: that `compare(model=…)` takes.
        specimen: that it is a model of.
        session: that it was fitted to.
        parent: the model that it came from.
        created_utc: when it was made.
        method: `map` or `slsqp`.
        added, removed: effects, in this step.
        effects: that the model holds.
        evidence: what spoke for the step.
        before, after: errors by `role/location`, before and after the fit.
        history: every step from the finger as it was read to this one.
        in_force: whether it stood for the specimen when it was asked for.
        body: the whole answer.
    """

    id: str
    specimen: str
    session: str
    parent: str
    created_utc: str
    method: str | None
    added: tuple[str, ...]
    removed: tuple[str, ...]
    effects: tuple[str, ...]
    evidence: Mapping[str, Any] | None = field(repr=False)
    before: Summary = field(repr=False)
    after: Summary = field(repr=False)
    history: tuple[Step, ...] = field(repr=False)
    in_force: bool
    body: Body = field(repr=False)
    _exchange: Exchange = field(repr=False)

    @classmethod
    def of(cls, exchange: Exchange, body: Body) -> Revision:
        """Of the service's answer."""
        with reading("a revision"):
            return made(
                cls,
                body,
                added=names(body["added"]),
                removed=names(body["removed"]),
                effects=names(body["effects"]),
                before=summary_of(body["before"]),
                after=summary_of(body["after"]),
                history=tuple(Step.of(step) for step in body["history"]),
                body=body,
                _exchange=exchange,
            )

    @classmethod
    def read(cls, exchange: Exchange, name: str) -> Revision:
        """Ask for it."""
        return cls.of(exchange, exchange.get(path_of("revisions", name)))

    def rmse_N(self, group: str, plane: str | None = None) -> float:  # noqa: N802 - N is the unit
        """Return the RMSE of a group of load cases after the fit, as `Comparison.rmse_N`."""
        told = self.history[-1].rmse_N if self.history else {}
        if plane is None and group in told:
            value = told[group]
            return np.nan if value is None else value
        return rmse_of(self.after, group, plane or "space")

    def document(self) -> Body:
        """Return it as the file that `fingertwin compare --model` takes."""
        return self._exchange.get(path_of("revisions", self.id, "document"))

    def provenance(self) -> Body:
        """Return which readings, corrections, model, job and software it came from."""
        with reading("a revision"):
            found: Body = self._exchange.get(path_of("revisions", self.id))["provenance"]
            return found

    def plot(self) -> go.Figure:
        """Return a figure of how the error fell with every step, drawn by the service."""
        return figure(self._exchange, "revisions/waterfall", revision=self.id)

    def export(self, path: str | Path, file_format: str | None = None) -> Path:
        """Write it, and return the file.

        Args:
            path: of the file.
            file_format: json (the document, which `--model` takes), csv, columns, parquet or xlsx; by default by
                its name.
        """
        asked = {"format": format_of(Path(path), file_format)}
        return fetched(self._exchange, path_of("revisions", self.id, "export"), Path(path), asked)

    def restore(self, why: str) -> Revision:
        """Put it in force again, for a reason; what stood for the specimen is kept.

        Raises:
            ServiceError: 409, it is in force already.
        """
        return Revision.of(self._exchange, self._exchange.post(path_of("revisions", self.id, "restore"), {"why": why}))


def model_name(model: str | Revision | None) -> str | None:
    """The name of a model by which the service knows it."""
    return model.id if isinstance(model, Revision) else model
