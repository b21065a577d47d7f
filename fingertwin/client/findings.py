"""What jobs come to: fits, findings of a diagnosis, next load cases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fingertwin.client.exchange import Body, Exchange, reading
from fingertwin.client.figures import figure
from fingertwin.client.summaries import Parameter, Summary, made, names, rmse_of, summary_of

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class Fit:
    """A refit.

    Attributes:
        session: id of the session.
        model: id of the revision that it made, which `compare(model=…)` takes.
        method: `map` or `slsqp`.
        outcome: such as `converged`.
        message: the outcome in words.
        parameters: with their uncertainties.
        before, after: errors by `role/location`.
        judged_in: plane that the model's axes can predict.
        body: the whole answer, as `fingertwin refit --json` gives it.
    """

    session: str
    model: str
    method: str
    outcome: str
    message: str
    parameters: tuple[Parameter, ...] = field(repr=False)
    before: Summary = field(repr=False)
    after: Summary = field(repr=False)
    judged_in: str
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Fit:
        """Of a job's result."""
        with reading("a refit"):
            parameters = tuple(Parameter.of(p) for p in body["parameters"])
            before, after = summary_of(body["before"]), summary_of(body["after"])
            return made(cls, body, parameters=parameters, before=before, after=after, body=body)

    def rmse_N(self, group: str, plane: str | None = None) -> float:  # noqa: N802 - N is the unit
        """Return the RMSE of a group of load cases after the fit, as `Comparison.rmse_N`."""
        return rmse_of(self.after, group, plane or self.judged_in)


@dataclass(frozen=True, eq=False)
class Explanation:
    """A row of a diagnosis' ranking.

    Attributes:
        effects: of the catalogue; none where nothing is missing.
        candidates: the very variants, such as `worn_pulley.FDP`.
        probability: of exactly this explanation.
        log_evidence_gain: over nothing missing; None where it fell out before it was weighed.
        validation_rmse_N: (before, after) on the validation cases.
        parameters: sizes of the effects.
        indistinguishable_from: candidates that these load cases do not tell apart from it.
    """

    effects: tuple[str, ...]
    candidates: tuple[str, ...]
    probability: float
    log_evidence_gain: float | None
    validation_rmse_N: tuple[float | None, float | None]
    parameters: tuple[Parameter, ...]
    indistinguishable_from: tuple[str, ...]

    @property
    def name(self) -> str:
        """What is missing, in short."""
        if self.effects and not self.candidates:
            return "something else"
        return " + ".join(self.candidates) or "nothing missing"

    @classmethod
    def of(cls, body: Body) -> Explanation:
        """Of plain data."""
        rmse = body["validation_rmse_N"]
        return made(
            cls,
            body,
            effects=names(body["effects"]),
            candidates=names(body["candidates"]),
            validation_rmse_N=(rmse["before"], rmse["after"]),
            parameters=tuple(Parameter.of(p) for p in body["parameters"]),
            indistinguishable_from=names(body["indistinguishable_from"]),
        )


@dataclass(frozen=True, eq=False)
class NextCase:
    """A load case worth measuring.

    Attributes:
        posture: name of the posture.
        location: `tip` or `bone`.
        masses_g: weight to hang on each tendon.
        information_nat: expected gain.
        separates: explanations that it would tell apart.
    """

    posture: str
    location: str
    masses_g: Mapping[str, float]
    information_nat: float
    separates: tuple[str, ...]

    @classmethod
    def of(cls, body: Body) -> NextCase:
        """Of plain data."""
        return made(cls, body, separates=names(body["separates"]))


@dataclass(frozen=True, eq=False)
class Finding:
    """What a diagnosis found.

    Attributes:
        session: id of the session.
        model: that was diagnosed.
        verdict: found, one_of, none_of_catalogue, nothing_missing or undecided.
        effects: members of the verdict; none for the last three.
        probability: of the verdict; None where it has none.
        sentence: the verdict in words.
        reasons: its grounds.
        ranking: every explanation that was tried, the most probable first.
        before, after: errors by `role/location`, without the effects and with them.
        next_cases: worth measuring.
        confirmed: whether predictions that were frozen earlier came true; None where none were.
        judged_in: plane that the model's axes can predict.
        body: the whole answer, as `fingertwin diagnose --json` gives it.
    """

    session: str
    model: str
    verdict: str
    effects: tuple[str, ...]
    probability: float | None
    sentence: str
    reasons: tuple[str, ...] = field(repr=False)
    ranking: tuple[Explanation, ...] = field(repr=False)
    before: Summary = field(repr=False)
    after: Summary = field(repr=False)
    next_cases: tuple[NextCase, ...] = field(repr=False)
    confirmed: bool | None
    judged_in: str
    body: Body = field(repr=False)
    _exchange: Exchange = field(repr=False)
    _job: str = field(repr=False)

    @classmethod
    def of(cls, exchange: Exchange, job: str, body: Body) -> Finding:
        """Of a job's result."""
        with reading("a diagnosis"):
            return made(
                cls,
                body,
                effects=names(body["effects"]),
                reasons=names(body["reasons"]),
                ranking=tuple(Explanation.of(row) for row in body["ranking"]),
                before=summary_of(body["before"]),
                after=summary_of(body["after"]),
                next_cases=tuple(NextCase.of(case) for case in body["next_cases"]),
                body=body,
                _exchange=exchange,
                _job=job,
            )

    def plot(self, name: str = "ranking") -> go.Figure:
        """Return a figure of it, drawn by the service.

        Args:
            name: ranking, size, sensitivity, residual_map, missing_torque, confounding, revisions (before and after) or
                held_out.
        """
        return figure(self._exchange, f"diagnosis/{name}", job=self._job)


@dataclass(frozen=True, eq=False)
class Plan:
    """Which load cases would best tell the remaining explanations apart.

    Attributes:
        session: id of the session.
        cases: worth measuring, the best first.
        instruments: what else would help.
        sentence: in words.
        frozen: SHA-256 of the predictions that were kept for a later diagnosis; None where none were.
        body: the whole answer, as `fingertwin next --json` gives it.
    """

    session: str
    cases: tuple[NextCase, ...]
    instruments: tuple[str, ...]
    sentence: str
    frozen: str | None
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Plan:
        """Of a job's result."""
        with reading("next load cases"):
            cases = tuple(NextCase.of(case) for case in body["next_cases"])
            return made(cls, body, cases=cases, instruments=names(body["instruments"]), body=body)
