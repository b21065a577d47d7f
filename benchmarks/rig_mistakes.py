"""How often a mistake of the whole rig is named, and how often a missing effect is taken for one.

    python -m benchmarks.rig_mistakes [--sessions 120] [--out FILE]

On sessions of the independent simulator, without an effect, with one, with two and with one from outside the catalogue:
each as it is, with axes exchanged or turned at both mounts or at one (drawn), and in another unit (drawn). Writes
`benchmarks/rig_mistakes.md`.
"""

from __future__ import annotations

import argparse
import datetime as dt
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import commit, publish
from benchmarks.recovery import KINDS, protocol_of
from fingermodel.diagnosis.model_free.frames import UNITS_N, rig_mistake
from fingermodel.session import Session
from tests.simulator import draw_session, draw_truth

Floats = NDArray[np.float64]

PLACES = (("tip", "bone"), ("tip",), ("bone",))
FIRST_SEED = 1000
MINUS = "\N{MINUS SIGN}"


def drawn_axes(rng: np.random.Generator) -> tuple[Floats, tuple[str, str]]:
    """Draw axes (3, 3) of which x or y is not as stated, and their names: a side for the other shows in no balance."""
    while True:
        order, signs = rng.permutation(3), rng.choice([-1.0, 1.0], 3)
        x, y = (f"{'' if signs[k] > 0.0 else MINUS}{'xyz'[order[k]]}" for k in (0, 1))
        if (x, y) != ("x", "y"):
            return np.diag(signs) @ np.eye(3)[order], (x, y)


def as_named(said: str | None, names: tuple[str, str], places: tuple[str, ...]) -> str:
    """Whether a mistake in the axes was named as it is: by x and y, z cannot be told; and where."""
    if said is None:
        return "not named"
    where = f"the forces at the {places[0]} " if len(places) == 1 else "the forces "
    turned = names == (f"{MINUS}x", f"{MINUS}y") and "turned round" in said
    right = f"were {where}" in said and (f"({names[0]}, {names[1]}, " in said or turned)
    return "named" if right else "something else named"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=120)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    options = parser.parse_args()
    found: dict[str, Counter[str]] = {"as it is": Counter(), "other axes": Counter(), "another unit": Counter()}
    rng = np.random.default_rng(FIRST_SEED)
    for k in range(options.sessions):
        for kind in KINDS:
            seed = FIRST_SEED + k
            with tempfile.TemporaryDirectory() as folder:
                draw_session(Path(folder), seed, *draw_truth(kind, seed), protocol=protocol_of(seed))
                bench = Session.open(folder, catalogue=False)
            wrench = bench.observations.wrench
            found["as it is"]["not named" if said_of(bench, wrench) is None else "something else named"] += 1
            axes, names = drawn_axes(rng)
            places = PLACES[k % len(PLACES)]
            wrong, at = wrench.copy(), np.isin(bench.observations.locations, places)
            wrong[at] = np.concatenate([wrong[at, :3] @ axes, wrong[at, 3:] @ axes], axis=1)
            found["other axes"][as_named(said_of(bench, wrong), names, places)] += 1
            unit = str(rng.choice(list(UNITS_N)))
            said = said_of(bench, wrench / UNITS_N[unit])
            named = "named" if f"as {unit} have" in (said or "") else "something else named"
            found["another unit"]["not named" if said is None else named] += 1
    publish(options.out, report(found, options.sessions))


def said_of(bench: Session, wrench: Floats) -> str | None:
    """What is said of other readings of a session."""
    found = rig_mistake(bench.model, replace(bench.observations, wrench=wrench))
    return None if found is None else found.words


def report(found: dict[str, Counter[str]], sessions: int) -> list[str]:
    """Lines of the page."""
    columns = ("named", "not named", "something else named")
    day = dt.datetime.now(tz=dt.UTC).date()
    return [
        "# Mistakes of the whole rig",
        "",
        f"`python -m benchmarks.rig_mistakes --sessions {sessions}`, {day}, commit {commit()}",
        "",
        f"Sessions of the independent simulator: {sessions} each without an effect, with one, with two and with one",
        "from outside the catalogue; errors of the rig 0.5 to 2 times the budget. Each as it is, with axes taken for",
        "others at both mounts or at one, and with forces in another unit. *Named* are those whose mount, x and y are",
        "told rightly: next to nothing pulls sideways, so z is not asked for, nor is a mistake of z alone made.",
        "",
        f"| readings | {' | '.join(columns)} |",
        "|---|---|---|---|",
        *(f"| {what} | {' | '.join(str(counts[c]) for c in columns)} |" for what, counts in found.items()),
        "",
        "Not named are mistakes at the tip that miss the balance by less than four times what an effect makes it miss.",
        "",
    ]


if __name__ == "__main__":
    main()
