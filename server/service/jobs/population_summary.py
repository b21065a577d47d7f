"""Summary of the fits of a population run: per session and set of effects, and over the specimens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from daq.plain_json import clean

Result = dict[str, Any]
# Of a fit whose values hold.
_GOOD = ("converged", "stalled")


def summarise(
    effects: Sequence[Sequence[str]], sessions: Sequence[str], parts: Mapping[str, Result], level: float
) -> Result:
    """Summarise the fits.

    Args:
        effects: sets of candidates, in the run's order.
        sessions: ids, in the run's order.
        parts: results by key `session/set/replicate`; replicate 0 is the fit to the measured readings.
        level: of the percentile intervals.
    """
    by_set: dict[tuple[int, str], list[Result]] = {}
    for key in sorted(parts, key=lambda k: int(k.rpartition("/")[2])):
        session, place, _ = key.rsplit("/", 2)
        by_set.setdefault((int(place), session), []).append(parts[key])
    sets = []
    for number, names in enumerate(effects):
        each = {s: _of_session(by_set[number, s], level) for s in sessions}
        sets.append({"effects": list(names), "sessions": each, "specimens": _over_specimens(list(each.values()))})
    out: Result = clean({"schema": "fingertwin/population/1", "level": level, "sets": sets})
    return out


def _of_session(fits: Sequence[Result], level: float) -> Result:
    """Summarise one session under one set of effects; the first fit is the one to the measured readings."""
    measured, drawn = fits[0], fits[1:]
    good = [f for f in drawn if f["outcome"] in _GOOD]
    return {
        "specimen": measured["specimen"],
        "judged_in": measured["judged_in"],
        "outcome": measured["outcome"],
        "added": measured["added"],
        "log_evidence_gain": measured["log_evidence_gain"],
        "replicates": len(drawn),
        "not_converged": len(drawn) - len(good),
        "parameters": {
            name: {"unit": unit} | _spread(measured, good, lambda f, n=name: f["values"][n], level)  # type: ignore[misc]
            for name, unit in measured["units"].items()
        },
        "rmse_N": {
            place: {
                plane: _spread(measured, good, lambda f, a=place, b=plane: f["rmse_N"][a][b], level)  # type: ignore[misc]
                for plane in planes
            }
            for place, planes in measured["rmse_N"].items()
        },
    }


def _spread(measured: Result, drawn: Sequence[Result], value: Callable[[Result], float], level: float) -> Result:
    """Return the measured value, and mean, standard deviation and percentiles of those drawn."""
    values = np.array([value(f) for f in drawn], dtype=float)
    few = len(values) < 2
    low, high = (None, None) if few else np.quantile(values, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return {
        "estimate": value(measured),
        "mean": float(values.mean()) if len(values) else None,
        "sd": None if few else float(values.std(ddof=1)),
        "low": low,
        "high": high,
    }


def _over_specimens(sessions: Sequence[Result]) -> Result:
    """Return the mean of the specimens' estimates and how they differ; sessions of one specimen count as one."""
    parameters = dict.fromkeys(name for s in sessions for name in s["parameters"])
    places = dict.fromkeys(
        (place, plane) for s in sessions for place, planes in s["rmse_N"].items() for plane in planes
    )
    rmse: dict[str, Result] = {}
    for place, plane in places:
        found = [(s["specimen"], s["rmse_N"][place][plane]) for s in sessions if place in s["rmse_N"]]
        rmse.setdefault(place, {})[plane] = _between(found)
    return {
        "parameters": {
            name: _between([(s["specimen"], s["parameters"][name]) for s in sessions if name in s["parameters"]])
            for name in parameters
        },
        "rmse_N": rmse,
    }


def _between(found: Sequence[tuple[str, Result]]) -> Result:
    """Return mean and standard deviation between specimens, and the RMS spread within sessions."""
    specimens: dict[str, list[float]] = {}
    for specimen, spread in found:
        specimens.setdefault(specimen, []).append(spread["estimate"])
    values = np.array([np.mean(v) for v in specimens.values()])
    within = [s["sd"] for _, s in found if s["sd"] is not None]
    return {
        "specimens": len(values),
        "mean": float(values.mean()),
        "sd": float(values.std(ddof=1)) if len(values) > 1 else None,
        "sd_within": float(np.sqrt(np.mean(np.square(within)))) if within else None,
    }
