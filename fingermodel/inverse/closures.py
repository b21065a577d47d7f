"""What makes the muscle tensions behind a tip force determinate: the closures of the inverse analysis.

Four joint torques balance a tip force, but more tendons than that can pull. A closure says how the rest is settled:

- `minimal`: the finger without its hood (Hu et al. 2014a, Eqs 1–3). A primary flexor PF runs as FDP does, a primary
  extensor PE as terminal slip, central slip and long extensor do; with RI and UI these are four tensions for four
  moments, and with the nine components of contact force 13 unknowns for 13 equations.
- `chao`: the sharing laws of the hood (Hu et al. 2014a, Eqs 7–11, after Chao et al. 1989): five laws and four moments
  for nine tensions (TE, RB, UB, ES, LE, FDP, RI, UI, LU). FDS is merged with FDP.
- `least_squares`: the least sum of squared stresses (tension over PCSA) among tensions that pull, with the finger's own
  hood (`least_stress.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError, ModelError
from fingermodel.fingers import Hood, Topology
from fingermodel.hood.parts import ElasticHood

Floats = NDArray[np.float64]
# What each slip takes of what: the law says slip = Σ share × source.
Law = tuple[str, tuple[tuple[str, float], ...]]

NAMES = {
    "minimal": "four muscles, no hood (Hu 2014a, Eqs 1-3)",
    "chao": "the hood's sharing laws (Hu 2014a, Eqs 7-11)",
    "least_squares": "least sum of squared stresses",
}


class Muscle(NamedTuple):
    """A muscle as a closure has it.

    Attributes:
        name: of the muscle, or of those merged in it.
        slip: of the finger whose tension is the muscle's.
        merged: the finger's muscles that it stands for.
    """

    name: str
    slip: str
    merged: tuple[str, ...]


@dataclass(frozen=True)
class Closure:
    """A closure for one finger.

    Attributes:
        name: one of `NAMES`.
        title: what it is, in a few words.
        muscles: that it knows.
        laws: that hold between the tensions of slips, beside the moments; none for `least_squares`.
    """

    name: str
    title: str
    muscles: tuple[Muscle, ...]
    laws: tuple[Law, ...] = ()

    def matrix(self, topology: Topology) -> Floats:
        """The laws as rows that are zero with the slips' tensions: (laws, slips), slips as in `slip_names`."""
        slips = slip_names(topology)
        rows = np.zeros((len(self.laws), len(slips)))
        for row, (slip, shares) in zip(rows, self.laws, strict=True):
            row[slips.index(slip)] = 1.0
            for source, share in shares:
                row[slips.index(source)] -= share
        return rows


def slip_names(topology: Topology) -> tuple[str, ...]:
    """Names of the tendons and slips that cross any joint, each once."""
    return tuple(dict.fromkeys(segment.slip for segment in topology.segments))


def closure_of(name: str, topology: Topology) -> Closure:
    """The closure of that name for a finger.

    Raises:
        InputError: there is none of that name.
        ModelError: a finger without the tendons that it speaks of.
    """
    if name not in NAMES:
        raise InputError(f"no closure {name!r}", f"one of {', '.join(NAMES)}")
    if name == "least_squares":
        return Closure(name, NAMES[name], tuple(Muscle(m, m, (m,)) for m in topology.muscles))
    hood, extensor = _hood(name, topology)
    have = set(topology.muscles)
    flexors = tuple(m for m in ("FDP", "FDS") if m in have)
    laws: list[Law] = [("FDS", ())] if "FDS" in have else []
    muscles: tuple[Muscle, ...]
    if name == "minimal":
        laws += [(slip, ((extensor, 1.0),)) for slip in (hood.terminal_slip, hood.central_slip)]
        laws += [(slip, ()) for slip in (hood.radial_band, hood.ulnar_band)]
        laws += [("LU", ())] if "LU" in have else []
        muscles = (
            Muscle("PF", "FDP", flexors),
            Muscle("PE", extensor, (extensor,)),
            Muscle("RI", "RI", tuple(m for m in ("RI", "LU") if m in have)),
            Muscle("UI", "UI", ("UI",)),
        )
    else:
        sixth = (extensor, 1.0 / 6.0)
        central = (*((m, 1.0 / 3.0) for m in ("RI", "UI", "LU")), sixth)
        laws += [
            (hood.radial_band, (("LU", 2.0 / 3.0), sixth)),
            (hood.ulnar_band, (("UI", 1.0 / 3.0), sixth)),
            (hood.terminal_slip, ((hood.radial_band, 1.0), (hood.ulnar_band, 1.0))),
            (hood.central_slip, central),
            (extensor, ((hood.central_slip, 1.0),)),
        ]
        own = tuple(Muscle(m, m, (m,)) for m in ("RI", "LU", "UI"))
        muscles = (Muscle("FDP", "FDP", flexors), Muscle(extensor, extensor, (extensor,)), *own)
    closure = Closure(name, NAMES[name], muscles, tuple(laws))
    _require_square(closure, topology)
    return closure


def _hood(name: str, topology: Topology) -> tuple[Hood | ElasticHood, str]:
    """The finger's hood, whose slips the laws speak of, and its one extensor."""
    hood = topology.hood
    needed = ("FDP", "RI", "UI") if name == "minimal" else ("FDP", "RI", "UI", "LU")
    missing = [m for m in needed if m not in topology.muscles]
    if hood is None or missing or len(hood.extensors) != 1:
        found = f"without {missing[0]}" if missing else "without one long extensor that enters a hood"
        raise ModelError(
            f"closure {name} for a finger {found}",
            f"{', '.join(needed)}, one long extensor and a hood",
            "least_squares takes any finger",
        )
    return hood, hood.extensors[0]


def _require_square(closure: Closure, topology: Topology) -> None:
    unknown, equations = len(slip_names(topology)), len(topology.rotations) + len(closure.laws)
    if unknown != equations:
        raise ModelError(
            f"closure {closure.name} leaves {unknown} tensions for {equations} equations",
            "a finger with four rotations and the tendons of An et al. 1979",
            "least_squares takes any finger",
        )
