"""Input of the figures of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fingermodel.comparison.comparison import Comparison
    from fingermodel.comparison.observations import Observations
    from fingermodel.fingers import FingerValues
    from fingermodel.model import Model
    from fingermodel.session import Session
    from server.figures.arrows import Spread


@dataclass(frozen=True, eq=False)
class Compared:
    """A comparison, with the model and the session that it is of."""

    model: Model  # that was compared
    observations: Observations  # of the session, for postures and tensions
    comparison: Comparison  # of both
    before: tuple[str, Comparison] | None = None  # name and comparison of the model that it is held against
    # Between specimens by case, where the session is their average (see `arrows.spread_between`).
    spread: Mapping[str, Spread] | None = None
    theta: NDArray[np.float64] | None = None  # fitted parameters of `comparison`; by default the model before any fit
    name: str = "Model"  # of the model, for titles

    @classmethod
    def of(
        cls,
        session: Session,
        comparison: Comparison,
        before: tuple[str, Comparison] | None = None,
        spread: Mapping[str, Spread] | None = None,
        *,
        theta: NDArray[np.float64] | None = None,
        name: str = "",
    ) -> Compared:
        """Make it of a session; parameters and name are those of its model unless they are given.

        Args:
            session: with its model.
            comparison: of its cases, or of some.
            before: name and comparison of the model that it is held against.
            spread: between specimens by case.
            theta: fitted parameters of `comparison`.
            name: of the model.
        """
        fitted = session.theta if theta is None else theta
        named = name or session.loaded.name
        return cls(session.model, session.observations, comparison, before, spread, fitted, named)

    @property
    def models(self) -> list[tuple[str, Comparison]]:
        """Names and comparisons: of the model before, where there is one, and of the model itself."""
        return [*([] if self.before is None else [self.before]), (self.name, self.comparison)]

    @property
    def values(self) -> FingerValues:
        """The finger's numbers, as fitted."""
        return self.model.finger.values if self.theta is None else self.model.values_at(self.theta)
