"""How often the stated 95 % intervals of `refit` and `add` hold the truth, on benches whose loads scatter.

    python -m benchmarks.intervals [--each 20] [--seed-from COMMIT] [--out FILE]

Finger and rig are drawn from the priors, and every tension scatters about what the session's file says by 0, 1, 2 and
3 % from case to case; no file states that. `refit` where nothing is missing, `add` where every hanger weighs something
that no file states; each with the errors of the readings as they have them, and as they are stated (as any
least-squares fit counts that is told of nothing else). Seeds come from a commit's name. Writes
`benchmarks/intervals.md`.
"""

from __future__ import annotations

import datetime as dt
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.machine import commit, publish, sessions_parser
from benchmarks.random_worlds import base_seed
from tests.recovery.rigs import misstate, record

if TYPE_CHECKING:
    from fingermodel.fitting.fit_report import Fit

SCATTERS = (0.0, 0.01, 0.02, 0.03)
# A hanger of which no file knows [g].
HANGER_G = 12.0
# Standard uncertainties of a 95 % interval; starts of the solver.
WITHIN, STARTS = 1.96, 4


class Held(NamedTuple):
    """What of one session the intervals hold.

    Attributes:
        scatter: of the loads, in truth and as read.
        shares: of the parameters whose interval holds the truth, with errors as read and as stated.
        effect: whether that of the hanger does, likewise.
        misses: of the hanger [g], likewise.
    """

    scatter: tuple[float, float]
    shares: tuple[float, ...]
    effect: tuple[bool, ...]
    misses: tuple[float, ...]


def one_session(seed: int, scatter: float) -> Held:
    """Draw a session and its twin with hangers; refit the one, add to the other."""
    from fingermodel.api import add, refit
    from fingermodel.fitting.identification import refit_map
    from fingermodel.session import Session
    from tests.stated import stated_problem

    def stated(bench: Session, freed: Sequence[str]) -> Fit:
        return refit_map(stated_problem(bench.model, bench.observations, effects=freed), starts=STARTS)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "session.yaml"
        truth, _ = record(Path(folder), seed)
        misstate(file, seed, scatter)
        bench = Session.open(folder)
        fit = refit(bench, starts=STARTS)
        shares = [_share(f, truth) for f in (fit, stated(bench, ()))]
        misstate(file, seed, 0.0, HANGER_G)
        bench = Session.open(folder)
        name = "hanger_mass.m0"
        mass = [f.parameter(name) for f in (add(bench, "hanger_mass", starts=STARTS).fit, stated(bench, (name,)))]
    misses = tuple(p.value - HANGER_G for p in mass)
    within = tuple(abs(off) < WITHIN * (p.sd or 0.0) for off, p in zip(misses, mass, strict=True))
    return Held((scatter, fit.errors.scatter), tuple(shares), within, misses)


def _share(fit: Fit, truth: Mapping[str, float]) -> float:
    known = [p for p in fit.parameters if p.identified and p.sd]
    return float(np.mean([abs(p.value - truth[p.name]) < WITHIN * (p.sd or 0.0) for p in known]))


def report(rows: Sequence[Held], each: int) -> list[str]:
    """Lines of the page."""
    out = [
        "# Intervals on benches that scatter",
        "",
        f"`python -m benchmarks.intervals --each {each}`, {dt.datetime.now(tz=dt.UTC).date()}, commit {commit()}.",
        "",
        "Held by the stated 95 % interval, with errors as the readings have them (and as they are stated):",
        "",
        "| scatter, and as read | parameters of finger and rig | least session | hanger of 12 g | RMS miss [g] |",
        "|---|---|---|---|---|",
    ]
    for scatter in SCATTERS:
        mine = [r for r in rows if r.scatter[0] == scatter]
        share, effect, miss = (np.array([getattr(r, name) for r in mine]) for name in ("shares", "effect", "misses"))
        read = np.median([r.scatter[1] for r in mine])
        mean, least, held = share.mean(axis=0), share.min(axis=0), effect.sum(axis=0)
        rms = np.sqrt(np.mean(miss**2, axis=0))
        shares = " | ".join(f"{a:.0%} ({b:.0%})" for a, b in (mean, least))
        of_hanger = f"{held[0]} of {len(mine)} ({held[1]}) | {rms[0]:.2f} ({rms[1]:.2f})"
        out.append(f"| {100 * scatter:g} %, {100 * read:.2g} % | {shares} | {of_hanger} |")
    return [*out, ""]


def main() -> None:
    options = sessions_parser(__doc__, 20, "scatter", __file__).parse_args()
    base = base_seed(options.seed_from)
    plans = [(base + k, s) for k in range(options.each) for s in SCATTERS]
    publish(options.out, report([one_session(*plan) for plan in plans], options.each))


if __name__ == "__main__":
    main()
