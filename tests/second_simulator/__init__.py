"""A second simulator of bench sessions, so that a diagnosis is tried on more than one author's idea of what goes wrong.

It was written from the published papers and the catalogue's descriptions, without sight of the model that it tests and
of the first simulator; its forms differ from both.
"""

from tests.second_simulator.draws import Kind, Truth, write_session

__all__ = ["Kind", "Truth", "write_session"]
