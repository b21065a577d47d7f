"""The folder of a session: readings of a noisy cell through all load cases, and what was set and when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import yaml

from tests.simulator.finger import Floats
from tests.simulator.protocols import Protocol

RATE_HZ = 25.0
STEP = np.array([1 / 160] * 3 + [1 / 32] * 3)
COLUMNS = ("t_s", "Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm")
# Of the clamp and the swinging weight after a change of load; gone before any window opens.
_SETTLES_S = 0.1
REST = np.array([1.0, 1.0, 1.0, 15.0, 15.0, 15.0])


def record(
    folder: Path, protocol: Protocol, loads: Floats, wander: Callable[[Floats], Floats], noise_N: float, seed: int
) -> Floats:
    """Write `readings.parquet`.

    Args:
        folder: of the session.
        protocol: whose cases are loaded one after another.
        loads: (cases, 6) what the cell reads of each load [N, N mm].
        wander: of times (n,), adds (n, 6) by the clock.
        noise_N: white noise of one reading of force; torques have 6.7 mm times as much.
        seed: of the noise, the slow wandering of the zero and the unloaded readings.

    Returns:
        (cases, 6) wrench by case as the windows have it, tare removed, without noise.
    """
    # Further cases have draws of their own, so that they leave the readings before them as they were.
    rng, late = np.random.default_rng([seed, 3]), np.random.default_rng([seed, 6])
    t = np.arange(round(protocol.last_s * RATE_HZ) + 1) / RATE_HZ
    planned = round(protocol.end_s * RATE_HZ) + 1

    def noise() -> Floats:
        return np.concatenate([rng.normal(size=(planned, 6)), late.normal(size=(len(t) - planned, 6))])

    starts, levels, swings = [0.0], [np.zeros(6)], [0.0]
    rest, block = np.zeros(6), None
    for case, load in zip(protocol.cases, loads, strict=True):
        if case.block != block:
            # The finger's weight and how its clamps hold it.
            block = case.block
            rest = (rng if case.block_start_s < protocol.end_s else late).normal(size=6) * REST
            starts.append(case.block_start_s)
            levels.append(rest)
            # By the time a block begins, its posture is set and nothing swings.
            swings.append(0.0)
        starts.append(case.load_start_s)
        levels.append(rest + load)
        swings.append(1.0)
    clock = wander(t)
    signal = settling(t, starts, levels, swings) + clock
    sd = noise_N * np.array([1.0] * 3 + [6.7] * 3)
    creep = rng.uniform(0.5, 2.0) * np.array([0.01] * 3 + [0.05] * 3) / 60.0 / np.sqrt(RATE_HZ)
    signal += sd * noise()
    signal += np.cumsum(creep * noise(), axis=0)
    signal = np.round(signal / STEP) * STEP
    table = pa.table(dict(zip(COLUMNS, [np.round(t, 4), *signal.T], strict=True)))
    pa.parquet.write_table(table, folder / "readings.parquet", compression="zstd")
    return loads + np.array([_mean(t, clock, c.loaded_s) - _mean(t, clock, c.unloaded_s) for c in protocol.cases])


def settling(t: Floats, starts: Sequence[float], levels: Sequence[Floats], swings: Sequence[float]) -> Floats:
    """What a cell without noise reads (n, 6) at times t (n,).

    Args:
        t: times [s].
        starts: when each level begins [s].
        levels: (6,) each [N, N mm].
        swings: share of each jump to a level that settles only after it.
    """
    at = np.searchsorted(starts, t + 1e-9, side="right") - 1
    jump = np.diff(np.array(levels), axis=0, prepend=0.0) * np.array(swings)[:, None]
    since = (t - np.array(starts)[at])[:, None]
    out: Floats = np.array(levels)[at] - jump[at] * np.exp(-since / _SETTLES_S)
    return out


def _mean(t: Floats, values: Floats, window: tuple[float, float]) -> Floats:
    first, last = np.searchsorted(t, [window[0] - 1e-9, window[1] + 1e-9])
    out: Floats = values[first:last].mean(axis=0)
    return out


def write_session(folder: Path, protocol: Protocol, session_id: str) -> None:
    """Write `session.yaml`: what was meant to be set, nothing of what was really so."""
    locations = dict.fromkeys(c.location for c in protocol.cases)
    frames = {"tip": "distal_phalanx", "bone": "metacarpal"}
    cases: list[dict[str, Any]] = []
    for c in protocol.cases:
        entry: dict[str, Any] = {"id": c.id, "role": c.role, "posture": c.posture, "location": c.location}
        entry |= {"masses_g": dict(c.masses_g), "unloaded_s": list(c.unloaded_s), "loaded_s": list(c.loaded_s)}
        entry |= {key: value for key, value in (("setting", c.setting), ("mounting", c.mounting)) if value}
        cases.append(entry)
    document = {
        "format": "bench-session/1",
        "id": session_id,
        "specimen": {"id": session_id, "species": "human", "digit": "third", "side": "right"},
        "finger": "an1979_middle",
        "readings": "readings.parquet",
        "load_cell": {
            "model": "ATI Nano17-E SI-25-0.25",
            "rate_hz": RATE_HZ,
            "mounts": {location: {"frame": frames[location]} for location in locations},
        },
        "gravity_m_s2": 9.81,
        "tension_factor": protocol.tension_factor,
        "postures_deg": protocol.postures_deg,
        "cases": cases,
    }
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(document, Dumper=dumper, sort_keys=False, default_flow_style=None, width=110)
    (folder / "session.yaml").write_text(text, encoding="utf-8")
