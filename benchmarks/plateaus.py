"""How often the stated 95 % interval of a plateau's mean holds the truth, on records with correlated noise.

    python -m benchmarks.plateaus [--windows 2000] [--out FILE]

Each window has six axes of independent first-order autoregressions of unit variance about zero, so that each tries six
intervals; what is tried is `daq.recordings.plateaus.reduce_window`, as a session and the bench use it.
"""

from __future__ import annotations

import argparse
import datetime as dt
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.machine import commit, describe_machine, publish
from daq.recordings.plateaus import reduce_window

Floats = NDArray[np.float64]

HERE = Path(__file__).parent
CORRELATIONS = (0.0, 0.6, 0.9)
# Rate [Hz] and length [s]; the second and the last are typical of a slow and of a fast cell.
WINDOWS = ((25.0, 1.0), (25.0, 2.0), (25.0, 3.0), (100.0, 3.0), (1000.0, 3.0))
AIM = (93.0, 97.0)
SETTLED = 400


def autoregression(phi: float, shape: tuple[int, int], rng: np.random.Generator) -> Floats:
    """(channels, n) of unit variance."""
    noise = rng.normal(size=(shape[0], shape[1] + SETTLED))
    out: Floats = lfilter([1.0], [1.0, -phi], noise, axis=1)[:, SETTLED:] * np.sqrt(1.0 - phi**2)
    return out


def sd_of_mean(phi: float, n: int) -> float:
    """True standard deviation of the mean of n readings."""
    lags = np.arange(1, n)
    return float(np.sqrt((1.0 + 2.0 * ((1.0 - lags / n) * phi**lags).sum()) / n))


def covered(phi: float, rate_hz: float, length_s: float, windows: int) -> list[str]:
    """Reduce windows of one kind; return a row of the table."""
    n = round(rate_hz * length_s)
    rng = np.random.default_rng([n, round(10 * phi)])
    t_s = np.arange(n) / rate_hz
    inside, normal, sds, halves = 0, 0, [], []
    for _ in range(windows):
        plateau = reduce_window(t_s, np.ascontiguousarray(autoregression(phi, (6, n), rng).T))
        low, high = plateau.interval()
        sd = np.sqrt(np.diag(plateau.covariance))
        inside += int(((low < 0.0) & (high > 0.0)).sum())
        normal += int((np.abs(plateau.mean) < 1.96 * sd).sum())
        sds.append(sd)
        halves.append(0.5 * (high - low))
    true = sd_of_mean(phi, n)
    share = 100.0 * inside / (6 * windows)
    return [
        f"{rate_hz:g} Hz × {length_s:g} s",
        f"{n}",
        f"{phi:g}",
        f"{1.0 / true**2:.1f}",
        f"{share:.1f} %" + ("" if AIM[0] <= share <= AIM[1] else " (outside)"),
        f"{100.0 * normal / (6 * windows):.1f} %",
        f"{np.median(sds) / true:.2f}",
        f"{np.median(halves) / (1.96 * true):.2f}",
    ]


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=2000)
    parser.add_argument("--out", type=Path, default=HERE / "plateaus.md")
    given = parser.parse_args()
    began = time.perf_counter()
    head = (
        "window",
        "readings",
        "autocorrelation",
        "worth so many independent ones",
        "95 % intervals that hold the truth",
        "mean ± 1.96 sd alone",
        "stated sd / true",
        "half width / the best possible",
    )
    rows = [covered(phi, *window, given.windows) for window in WINDOWS for phi in CORRELATIONS]
    chance = 2.0 * np.sqrt(0.95 * 0.05 / (6 * given.windows))
    lines = [
        "# Do a plateau's intervals hold the truth?",
        "",
        f"Made by `python -m benchmarks.plateaus --windows {given.windows}` on {dt.datetime.now(dt.UTC).date()},",
        f"commit {commit()}, in {time.perf_counter() - began:.0f} s. {describe_machine()}.",
        f"{6 * given.windows} intervals a row, so chance moves a share by ± {100 * chance:.1f} %.",
        f"Aim: {AIM[0]:g} to {AIM[1]:g} %.",
        "",
        f"| {' | '.join(head)} |",
        "|" + "---|" * len(head),
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
        "The noise is a first-order autoregression that a window knows nothing of. The interval is Student's, with the",
        "number of independent readings that the window itself shows, less one. A fit takes the covariance alone: that",
        "is the column beside it. The best possible half width is that of one who knows the noise. Widths and sd are",
        "medians.",
        "",
        "A window that is worth two or three independent readings cannot tell how correlated they are: its intervals",
        "are more than twice as wide as they could be, and hold the truth less often all the same. The remedy is a",
        "longer window. White noise in short windows errs to the safe side, because the largest of three estimates is",
        "taken.",
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
