"""Figures of a comparison, as one HTML page and as PNG and SVG, for whichever command was asked for them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from fingermodel.session import Session, readings_digest
from server.application.provenance import origin_of, provenance, told_first
from server.figures.compared import Compared
from server.figures.comparison import comparison_report
from server.figures.specimen_spread import spread_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fingermodel.comparison.comparison import Comparison


def draw_comparison(
    bench: Session,
    comparison: Comparison,
    folder: Path,
    *,
    before: Comparison | None = None,
    theta: NDArray[np.float64] | None = None,
    model_name: str = "",
    static: bool = True,
) -> Path:
    """Draw a comparison and return its page.

    Args:
        bench: session and model.
        comparison: to draw; of a refit, of the cases that count.
        folder: for `compare.html`, PNG and SVG.
        before: of the model before a refit.
        theta: fitted parameters of `comparison`; by default the bench's.
        model_name: for titles; by default the loaded model's.
        static: whether to write PNG and SVG too.
    """
    drawn, observations = {case.id for case in comparison.cases}, bench.observations
    cases = zip(observations.ids, observations.roles, strict=True)
    apart = ", ".join(case for case, role in cases if role != "check" and case not in drawn)
    left_out = [f"Left out, since a fit does not count what stands apart: {apart}."] if apart else []
    return comparison_report(
        folder,
        Compared.of(
            bench,
            comparison,
            None if before is None else (bench.loaded.name, before),
            spread_of(bench, comparison),
            theta=theta,
            name=model_name,
        ),
        session=bench.measured.session.id,
        notes=[*left_out, *comparison_notes(bench)],
        first=told_first(provenance(bench)),
        origin=origin_of(bench, readings_digest(bench.measured)),
        static=static,
    )


def comparison_notes(bench: Session) -> list[str]:
    """Return notes on the corrections and the model of a comparison."""
    measured = bench.measured
    factor = f"Friction factor c = {measured.tension_factor:g} ({measured.tension_factor_source})."
    return [factor, *measured.notes, *bench.loaded.notes]
