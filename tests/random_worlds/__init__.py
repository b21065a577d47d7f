"""Random worlds: bench sessions in which everything is drawn, the law that is hidden included.

The physics is that of the two simulators, which share no code with the product; laws outside the catalogue are composed
of a stage, muscles or a joint, a function of an angle and one of the load.
"""

from tests.random_worlds.worlds import Settings, World, draw_world, write_drawn, write_truth, write_world

__all__ = ["Settings", "World", "draw_world", "write_drawn", "write_truth", "write_world"]
