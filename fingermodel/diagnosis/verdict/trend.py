"""Whether what is left goes with time or with load, as neither noise nor scatter from case to case does.

Score tests of columns that no hypothesis has: of the tensions, of the cell's gain and of the joint angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import chdtrc

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.group_errors import waves
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.settings import FORM_NAMED, P_VALUE

# Information of a weight, and share of a column's, that is rounding.
_LEAST = 1e-6
# How far a tension, a gain [%] or an angle [°] may change with time or load.
_CHANGE = 5.0
# Where a trend is told: at the first case, halfway and at the last; at no load, half the largest and the largest.
_PLACES = np.array([0.0, 0.5, 1.0])
_GAIN = "the cell's gain"
_TOLD = {
    "time": ("at the first case", "halfway", "at the last"),
    "load": ("at a small load", "at half the largest", "at the largest"),
}


class _Asked(NamedTuple):
    """What may change along time or load."""

    what: str  # changes
    along: Literal["time", "load"]  # time or load
    unit: str  # of how far it has changed: `%` or `°`
    columns: Floats  # (n, 1 + k) change of every reading if it is off throughout, and by each part of its course
    course: Floats  # (3, k) those parts where it is told


@dataclass(frozen=True)
class Trend:
    """What of the rig or the load seems to change along time or load."""

    what: str  # changes: the cell's gain, what a tendon pulls, or a joint angle
    along: Literal["time", "load"]  # `time` or `load`
    p_value: float  # that chance makes so much of one of all that were asked
    log_evidence: float  # that it adds to the readings, as one of all that were asked
    size_N: float  # RMS of what it changes in the fitted force components
    unit: str  # of the course
    # How far it has changed at the first case, halfway and at the last; or at no load, half the largest load, and the
    # largest.
    course: tuple[float, ...]
    of_found: bool  # whether it changes what the explanation's effects change, off throughout

    @property
    def words(self) -> str:
        """What is seen, and by how much."""
        values = [f"{value:+.1f} {self.unit}".replace(" °", "°") for value in self.course]
        listed = ", ".join(f"{value} {place}" for value, place in zip(values, _TOLD[self.along], strict=True))
        return f"goes with {self.along}, as if {self.what} changed: {listed}"

    @property
    def sentence(self) -> str:
        """The same with how often chance makes it, and what measurement would show whether it is so."""
        return f"What is left {self.words} (chance makes so much with p = {self.p_value:.1g}); {self.remedy}"

    @property
    def remedy(self) -> str:
        """What measurement would show whether it is so."""
        if self.along == "time":
            return "measure the first load case again at the end"
        if self.what == _GAIN:
            return "hang known weights up to the largest load on the cell"
        return "measure more and smaller loads of that tendon"

    def as_dict(self) -> dict[str, Any]:
        """As the answer gives it."""
        return asdict(self) | {"sentence": f"{self.sentence}."}


def trend_of(fit: Optimum) -> Trend | None:
    """The most evident trend of what an explanation, and all that it leaves open, leave; None where chance makes it."""
    session, asked = fit.session, list(_asked(fit.session, fit.theta))
    if not asked:
        return None
    # Everything that acts besides is integrated out once for all of them.
    columns = np.concatenate([one.columns for one in asked], axis=1)[session.fitted]
    said = fit.quadratic_of(columns, fit.best)
    ends = np.cumsum([one.columns.shape[1] for one in asked]).tolist()
    spans = [slice(end - one.columns.shape[1], end) for end, one in zip(ends, asked, strict=True)]
    tested = [_tested(said.hessian[span, span], said.gradient[span]) for span in spans]
    # By its evidence: what would have to change out of all proportion is none of these.
    (p_value, log_evidence, weights), one = max(zip(tested, asked, strict=True), key=lambda of: of[0][1])
    p_value, log_evidence = p_value * len(asked), log_evidence - float(np.log(len(asked)))
    if p_value >= P_VALUE or log_evidence <= 0.0:
        return None
    change = np.zeros((len(session.observations.ids), 6))
    change.reshape(-1)[session.rows] = one.columns[:, 1:] @ weights
    course = tuple((one.course @ weights).tolist())
    found = np.sum(fit.changes, axis=0).reshape(-1)[session.rows] if fit.changes else np.zeros(len(session.rows))
    of_found = _across(found[session.fitted], one.columns[session.fitted, 0]) <= FORM_NAMED
    return Trend(one.what, one.along, p_value, log_evidence, fit.size_newton(change), one.unit, course, of_found)


def _across(change: Floats, column: Floats) -> float:
    """Share of a change (n,) that is not along a column (n,); 1 where there is no change."""
    size, along = float(change @ change), float(column @ column)
    return float(np.sqrt(max(1.0 - float(change @ column) ** 2 / (size * along), 0.0))) if size * along > 0.0 else 1.0


def _tested(information: Floats, score: Floats) -> tuple[float, float, Floats]:
    """P-value, log evidence and weights of all columns but the first, whose weight may be anything.

    Information (1 + k, 1 + k) and score (1 + k,) are of all weights.
    """
    # What the readings say nothing of has no information but rounding.
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    scale = np.divide(1.0, size, out=np.zeros(len(size)), where=size > _LEAST)
    information, score = information * np.outer(scale, scale), score * scale
    left = information[1:, 1:] - np.outer(information[1:, 0], information[0, 1:])
    turned, size, scale = score[1:] - information[1:, 0] * score[0], size[1:], scale[1:]
    values, vectors = np.linalg.eigh(left)
    sound = values > _LEAST
    if not sound.any():
        return 1.0, 0.0, np.zeros(len(turned))
    along = vectors[:, sound].T @ turned / values[sound]
    p_value = float(chdtrc(len(along), float((along**2 * values[sound]).sum())))
    evidence = Quadratic(0.0, turned * size, left * np.outer(size, size), 0.0).of_size(_CHANGE).log_evidence
    return p_value, evidence, vectors[:, sound] @ along * scale


def _asked(session: Session, theta: Floats) -> Iterator[_Asked]:
    """What may change, and how it would change the readings about some parameters.

    Along time nothing is asked where none is known.
    """
    topology, inputs, cases = session.model.finger.topology, session.observations.inputs, session.rows // 6
    tension, loaded = np.asarray(inputs.tension), ~np.asarray(inputs.is_check)[cases]
    read = session.changes.readings(theta)
    reading = 0.01 * loaded * read[cases, session.rows % 6]
    by_tension = 0.01 * session.changes.by_tension(theta)[cases, session.rows % 6]
    by_angle = np.deg2rad(1.0) * session.changes.by_angle(theta)[cases, session.rows % 6]
    pulling = [(f"what {m} pulls", k) for k, m in enumerate(topology.muscles) if by_tension[:, k].any()]
    time = np.asarray(inputs.elapsed)[cases]
    if lasts := float(np.ptp(time[loaded])) if loaded.any() else 0.0:
        slowly = waves((time - time[loaded].min()) / lasts)
        changes = [(_GAIN, "%", reading), *((what, "%", by_tension[:, k]) for what, k in pulling)]
        changes += [(f"the angle {rotation}", "°", by_angle[:, k]) for k, rotation in enumerate(topology.rotations)]
        for what, unit, change in changes:
            yield _Asked(what, "time", unit, _course(change, slowly), waves(_PLACES))
    for what, k in pulling:
        less = 1.0 - tension[cases, k] / tension[:, k].max()
        yield _Asked(what, "load", "%", _course(by_tension[:, k], less[:, None]), 1.0 - _PLACES[:, None])
    force = np.linalg.norm(read[:, :3], axis=1)[cases] * loaded
    if force.any():
        yield _Asked(_GAIN, "load", "%", _course(reading, force[:, None] / force.max()), _PLACES[:, None])


def _course(change: Floats, along: Floats) -> Floats:
    """Columns (n, 1 + k) of a change (n,): of one size throughout, and of each of some courses (n, k)."""
    return change[:, None] * np.column_stack([np.ones(len(change)), along])
