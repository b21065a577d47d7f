"""Sessions of a finger test in which everything is known, written by code that shares nothing with the product.

The physics is the published one, in plain NumPy; what departs from it (the effects) has forms of its own, so that a
diagnosis is tried on something other than its own formulas.
"""

from tests.simulator.draws import Hidden, Kind, Truth, draw_session, draw_truth
from tests.simulator.protocols import PROTOCOLS
from tests.simulator.situation import CATALOGUE, OUTSIDE, Effect, Size, sizes_of

__all__ = [
    "CATALOGUE",
    "OUTSIDE",
    "PROTOCOLS",
    "Effect",
    "Hidden",
    "Kind",
    "Size",
    "Truth",
    "draw_session",
    "draw_truth",
    "sizes_of",
]
