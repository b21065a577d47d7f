"""Measured forces of a bench run, and their agreement with predictions; validation cases stay blind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from daq.checks.cases import AXES, TARE_CHANGE
from daq.checks.weights import weight_findings
from daq.measured import MeasuredCheck
from daq.recordings.plateaus import Plateau
from daq.recordings.windows import Span
from daq.sessions.models import KnownWeight, LoadCase, Session
from daq.signals.calibration import mount_transform
from daq.signals.corrections import assemble

Floats = NDArray[np.float64]
Predict = Callable[[LoadCase], tuple[Floats, Floats] | None]


@runtime_checkable
class Likens(Protocol):
    """Predictor that also names the other case that a force resembles."""

    def __call__(self, case: LoadCase) -> tuple[Floats, Floats] | None:
        """Return the force (3,) and the half width (3,) of its band [N]."""
        ...

    def like(self, case: LoadCase, force_N: Floats) -> str:
        """Ask what hangs, where a force (3,) resembles another case's more than its own; else return nothing.

        It tells no prediction, so it may be asked about validation cases.
        """
        ...


COVERAGE = 2.0
# No finger multiplies its weights: as in `fingertwin check`.
MOST_SHARE, MOST_MORE_N = 1.5, 0.5
# How likely a channel may stand still by chance before it is remarked.
_NO_CHANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Result:
    """A force that was measured, and what was predicted where that may be seen.

    Attributes:
        case: its id.
        force_N: (3,) in mount axes, tare removed.
        sd_N: (3,) its standard uncertainty.
        predicted_N: (3,); band_N: (3,) half width of the band around it; None where there is none, or not yet.
    """

    case: str
    force_N: Floats
    sd_N: Floats
    predicted_N: Floats | None = None
    band_N: Floats | None = None

    @property
    def outside(self) -> bool | None:
        """True if the force lies outside the band, None where there is no band."""
        if self.predicted_N is None or self.band_N is None:
            return None
        return bool((np.abs(self.force_N - self.predicted_N) > self.band_N + COVERAGE * self.sd_N).any())

    def as_value(self) -> dict[str, Any]:
        """Return plain data for an event."""
        out: dict[str, Any] = {"case": self.case, "force_N": _plain(self.force_N), "sd_N": _plain(self.sd_N)}
        if self.predicted_N is not None and self.band_N is not None:
            out |= {"predicted_N": _plain(self.predicted_N), "band_N": _plain(self.band_N), "outside": self.outside}
        return out


class Forces:
    """Reduces what a run takes.

    Args:
        session: as planned, for mounts, side and gravity.
        predict: force and half width of a wide physical band of a case, in mount axes; None where it knows none.
    """

    def __init__(self, session: Session, predict: Predict | None) -> None:
        self._predict = predict
        self._gravity = session.gravity_m_s2
        mounts = session.load_cell.mounts if session.load_cell else {}
        self._transforms = {m: mount_transform(mounts.get(m), session.specimen.side) for m in ("tip", "bone")}
        self._plateaus: dict[Span, Plateau] = {}
        self._checks: list[MeasuredCheck] = []
        self.failure = ""

    def keep(self, window_s: Span, plateau: Plateau) -> None:
        """Remember a window that was confirmed."""
        self._plateaus[window_s] = plateau

    def live(self, case: LoadCase, loaded: Plateau, tare: Plateau, blind: bool) -> Result:
        """Return the force of a case that is not confirmed yet."""
        transform = self._transforms[case.location]
        force = transform.apply(loaded.mean - tare.mean)[:3]
        covariance = transform.apply_covariance(loaded.covariance + tare.covariance)
        return self._compared(case, force, np.sqrt(np.diag(covariance)[:3]), blind)

    def measured(self, session: Session, wanted: Sequence[str], blind: bool) -> list[Result]:
        """Measure cases as `daq.signals.corrections` does, with all tares that bracket them and what they share."""
        everything = assemble(session, self._plateaus)
        out = []
        for index, m in enumerate(everything.cases):
            if m.case.id in wanted:
                sd = np.sqrt(np.diag(everything.case_covariance(index))[:3])
                out.append(self._compared(m.case, m.wrench[:3], sd, blind))
        return out

    def doubts(self, case: LoadCase, result: Result) -> list[str]:
        """List why a force can hardly be right; of a validation case without numbers of a prediction."""
        out = []
        weight_N = sum(case.masses_g.values()) * 1e-3 * self._gravity
        force_N = float(np.linalg.norm(result.force_N))
        if force_N > MOST_SHARE * weight_N + MOST_MORE_N:
            out.append(f"{force_N:.2f} N for {weight_N:.2f} N of weights: wrong weight, or forgotten tare?")
        like = self._like(case, result.force_N)
        if like:
            out.append(f"{case.id} {like}")
        elif result.outside and result.predicted_N is not None:
            out.append(
                f"{case.id} reads {_vector(result.force_N)} N, far from {_vector(result.predicted_N)} N: "
                "wrong tendon, wrong weight, forgotten tare, or drift?"
            )
        return out

    def weigh(self, weight: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
        """Compare a known weight with its reading; return gain and crosstalk, and what is doubtful."""
        check = KnownWeight.model_validate(weight)
        loaded, unloaded = self._plateaus[check.loaded_s], self._plateaus[check.unloaded_s]
        transform = self._transforms[check.mount]
        self._checks.append(
            MeasuredCheck(
                force_N=np.array(check.direction) * check.mass_g * 1e-3 * self._gravity,
                wrench=transform.apply(loaded.mean - unloaded.mean),
                covariance=transform.apply_covariance(loaded.covariance + unloaded.covariance),
                when=check.when,
                mount=check.mount,
                mass_g=check.mass_g,
            )
        )
        findings, results = weight_findings(self._checks)
        mine = f"checks[{len(self._checks) - 1}]"
        doubts = [f.text for f in findings if f.level != "note" and (f.where.startswith(mine) or "at " in f.where)]
        return {k: round(results[-1][k], 6) for k in ("gain", "gain_sd", "crosstalk", "crosstalk_sd")}, doubts

    def _like(self, case: LoadCase, force: Floats) -> str:
        if not isinstance(self._predict, Likens) or not np.isfinite(force).all():
            return ""
        try:
            return self._predict.like(case, force)
        except Exception as error:  # the log must not end because a model fails
            self.failure = f"no prediction ({type(error).__name__}: {error})"
            return ""

    def _compared(self, case: LoadCase, force: Floats, sd: Floats, blind: bool) -> Result:
        # Not even asked for: what nobody has computed nobody can see.
        if self._predict is None or (blind and case.role == "validation"):
            return Result(case.id, force, sd)
        try:
            told = self._predict(case)
        except Exception as error:  # the log must not end because a model fails
            self.failure = f"no prediction ({type(error).__name__}: {error})"
            return Result(case.id, force, sd)
        if told is None or not np.isfinite(told).all():
            return Result(case.id, force, sd)
        return Result(case.id, force, sd, np.asarray(told[0]), np.asarray(told[1]))


def zero_moved(before: Plateau, after: Plateau) -> str:
    """Say by how much the zero has moved between two tares where that is too much."""
    change = after.mean - before.mean
    if (np.abs(change) <= TARE_CHANGE).all():
        return ""
    k = int(np.argmax(np.abs(change) / TARE_CHANGE))
    unit = "N" if k < 3 else "N mm"
    return (
        f"the zero of {AXES[k][:2]} has moved by {change[k]:+.2g} {unit} since the last tare: drift, slip, or a load?"
    )


def still_share(wrench: Floats) -> Floats:
    """Return of each channel (6,) which share of its readings (n, 6) is the same as the one before."""
    return np.asarray((np.diff(wrench, axis=0) == 0.0).mean(axis=0)) if len(wrench) > 1 else np.ones(6)


def stands_still(tare: Floats, loaded: Floats, readings: int) -> str:
    """Say which channels (6,) keep one number throughout, which they hardly do by chance: in the tare they changed.

    Args:
        tare: share of its readings that are the same as the one before.
        loaded: the same under load.
        readings: under load.
    """
    chance = tare ** max(readings - 1, 1)
    still = [AXES[k][:2] for k in np.flatnonzero((loaded == 1.0) & (chance < _NO_CHANCE))]
    if not still:
        return ""
    stand = "stands" if len(still) == 1 else "stand"
    return f"{' and '.join(still)} {stand} still, and did not in the tare: a channel at its limit, or a broken wire?"


def _plain(values: Floats) -> list[float]:
    return [round(float(v), 6) for v in values]


def _vector(values: Floats) -> str:
    return "(" + ", ".join(f"{v:+.2f}" for v in values) + ")"
