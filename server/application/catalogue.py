"""Effects as the command line, the service and the pages show them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from fingermodel.fingers.files import read_finger
from fingermodel.structure import ANY_LAYOUT

if TYPE_CHECKING:
    from fingermodel.fingers import Topology
    from fingermodel.stages import Effect


def effect_row(effect: Effect, topology: Topology | None = None) -> dict[str, Any]:
    """Return an effect as plain data: what it does, its formula, source and parameters.

    Args:
        effect: of the catalogue or the user's.
        topology: of the finger that it is to act on; by default that of An et al. 1979.
    """
    topology = topology or _standard()
    parameters = effect.parameters(topology, ANY_LAYOUT)
    return {
        "name": effect.name,
        "stage": effect.stage,
        "title": effect.title,
        "formula": effect.formula,
        "tell": effect.tell,
        "source": effect.source,
        "rests_on_clamp_assumption": effect.rests_on_clamp_assumption,
        "candidates": list(effect.variants(topology, ANY_LAYOUT)),
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "null": p.initial,
                "range": list(p.plausible) if p.plausible else None,
                "prior_sd": p.sd,
                "one_sided": p.one_sided,
            }
            for p in parameters
        ],
    }


@cache
def _standard() -> Topology:
    """Return the topology of An et al. 1979, read once: a list of effects asks for it with every row."""
    return read_finger("an1979_middle").topology
