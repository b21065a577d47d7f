"""Two fingers side by side, with the published numbers of such a comparison where the two are the paper's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fingermodel.studies import species
from fingermodel.studies.species import SpeciesResult
from server.reproduce.synek2019_species import species_rows


def compare_species(
    of: str | None = None,
    other: str | None = None,
    of_session: str | None = None,
    other_session: str | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> SpeciesResult:
    """Compare two fingers as `fingermodel.studies.species.compare_species`, with the paper's numbers beside ours."""
    result = species.compare_species(of, other, of_session, other_session, progress)
    return replace(result, rows=tuple(species_rows(result)))
