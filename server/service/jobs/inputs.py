"""Input of each kind of job, as values that go from the service to a worker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from daq.errors import InputError
from server.service.jobs.bench_input import BenchInput
from server.service.jobs.executors import ExecutorSettings

_MOST_REPLICATES = 10_000
_MOST_FITS = 1_000_000


@dataclass(frozen=True, eq=False)
class RefitInput:
    """`fingertwin refit`."""

    bench: BenchInput  # session and model
    method: str = "map"  # `map` or `slsqp`
    plane: str | None = None  # of the forces that count; by default what the finger's axes can predict

    def __post_init__(self) -> None:
        if self.method not in ("map", "slsqp"):
            raise InputError(f"method {self.method!r:.50}", "map or slsqp")
        if self.plane not in (None, "sagittal", "space"):
            raise InputError(f"plane {self.plane!r:.50}", "sagittal or space")
        if self.method == "slsqp" and self.plane is not None:
            raise InputError(f"plane {self.plane} with method slsqp", "no plane", "Eq 5 is posed in the sagittal plane")


@dataclass(frozen=True, eq=False)
class AddInput:
    """`fingertwin add`."""

    bench: BenchInput  # session and model
    # Names of effects or candidates, the user's own among them, or formulas with one coefficient k.
    effects: tuple[str, ...] = ()
    without: tuple[str, ...] = ()  # effects or parameters that the model has, to be taken out

    def __post_init__(self) -> None:
        if not self.effects and not self.without:
            raise InputError("nothing to add and nothing to take out", "at least one effect")


@dataclass(frozen=True, eq=False)
class DiagnoseInput:
    """`fingertwin diagnose`."""

    bench: BenchInput  # session and model
    thorough: bool = False  # more starts and pairs
    frozen: tuple[Mapping[str, Any], ...] = ()  # documents of predictions that were made before


@dataclass(frozen=True, eq=False)
class PooledInput:
    """`fingertwin diagnose` of several sessions."""

    benches: tuple[BenchInput, ...]  # sessions, each with its model
    thorough: bool = False  # more starts and pairs


@dataclass(frozen=True, eq=False)
class NextInput:
    """`fingertwin next`."""

    bench: BenchInput  # session and model
    freeze: bool = False  # whether what the explanations predict shall be written down


@dataclass(frozen=True, eq=False)
class ReproduceInput:
    """`fingertwin reproduce`."""

    study: str  # its name


@dataclass(frozen=True, eq=False)
class PopulationInput:
    """Fits of a population run."""

    benches: tuple[BenchInput, ...]  # sessions with their models
    effects: tuple[tuple[str, ...], ...] = ((),)  # sets of candidates to add; an empty one is the plain refit
    bootstrap: int = 100  # replicates of each session
    seed: int = 0  # of their draws
    level: float = 0.95  # of the percentile intervals
    executor: ExecutorSettings = field(default_factory=ExecutorSettings)  # where the fits are computed

    def __post_init__(self) -> None:
        names = [b.id for b in self.benches]
        sets = [frozenset(e) for e in self.effects]
        if not names or len(set(names)) < len(names):
            raise InputError(f"sessions {', '.join(names)[:200] or 'none'}", "at least one, and each once")
        if not sets or len(set(sets)) < len(sets):
            raise InputError(f"{len(sets)} sets of effects, {len(set(sets))} different", "at least one, and each once")
        if not 0 <= self.bootstrap <= _MOST_REPLICATES:
            raise InputError(f"bootstrap {self.bootstrap}", f"replicates from 0 to {_MOST_REPLICATES}")
        if not 0.5 <= self.level < 1.0:
            raise InputError(f"level {self.level:g}", "0.5 or more and below 1")
        if self.fits > _MOST_FITS:
            raise InputError(f"{self.fits} fits", f"at most {_MOST_FITS}", "Ask for fewer replicates or sets at once")

    @property
    def fits(self) -> int:
        """Number of fits, those to the measured readings included."""
        return len(self.benches) * len(self.effects) * (self.bootstrap + 1)

    @property
    def catalogue(self) -> bool:
        """True if the models must hold the catalogue of effects."""
        return any(self.effects)
