"""The folder of a session: readings of a noisy cell through all load cases, and what was set and when."""

from __future__ import annotations

import gzip
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.second_simulator.finger import Floats
from tests.second_simulator.outside import caught_share
from tests.second_simulator.protocols import Protocol
from tests.second_simulator.reading import GRAVITY, RATE_HZ, TENSION_FACTOR, Loads, wander
from tests.second_simulator.rig import Rig
from tests.second_simulator.situation import Case

_STEPS = np.array([160.0] * 3 + [32.0] * 3)
# Of the noise: from one reading to the next, and of torques against forces [mm].
_AFTER_EFFECT, _TORQUE_MM = 0.47, 19.6
_HEADER = "t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm"
_FRAMES = {"tip": "distal_phalanx", "bone": "metacarpal"}


def _smooth(x: Floats) -> Floats:
    """From 0 to 1 with level ends."""
    x = np.clip(x, 0.0, 1.0)
    out: Floats = x * x * (3.0 - 2.0 * x)
    return out


def _within(t: Floats, begins: float, ends: float) -> slice:
    """Readings from one moment to before another."""
    first, last = np.searchsorted(t, [begins - 1e-9, ends - 1e-9])
    return slice(int(first), int(last))


def _blocks(plan: Protocol) -> list[list[int]]:
    """Places of the cases that share a tare."""
    out: dict[int, list[int]] = {}
    for i, case in enumerate(plan.cases):
        out.setdefault(case.block, []).append(i)
    return list(out.values())


def _target(rig: Rig, loads: Loads, i: int, t: Floats) -> Floats:
    """What hangs in a case at these times (n, 6)."""
    out = np.tile(loads.held[i], (len(t), 1))
    share = caught_share(rig.acting, rig.plan.cases[i], t)
    return out if share is None else out + share[:, None] * (loads.caught[i] - loads.held[i])


def _loaded(rig: Rig, loads: Loads, block: Sequence[int], t: Floats, ends_s: float) -> Floats:
    """One block without its resting load: each weight swings in, the last is taken off (n, 6)."""
    cases = rig.plan.cases
    out = np.zeros((len(t), 6))
    begins = [cases[i].hung_s for i in block] + [cases[block[-1]].loaded_s[1] + 0.1]
    before = np.zeros(6)
    for i, start, end in zip(block, begins, begins[1:], strict=False):
        now = _within(t, start, end)
        since = t[now] - start
        swing = 0.25 * np.exp(-since / 0.22) * np.sin(2.0 * np.pi * 2.6 * since)
        target = _target(rig, loads, i, t[now])
        out[now] = before + (target - before) * (_smooth(since / 0.45) + swing)[:, None]
        before = target[-1]
    off = _within(t, begins[-1], ends_s)
    out[off] = before * (1.0 - _smooth((t[off] - begins[-1]) / 0.4))[:, None]
    return out


def _coloured(white: Floats) -> Floats:
    """Noise of which a part stays from one reading to the next."""
    out = np.empty_like(white)
    fresh = np.sqrt(1.0 - _AFTER_EFFECT**2) * white
    rest = np.zeros(white.shape[1])
    for i, new in enumerate(fresh):
        rest = _AFTER_EFFECT * rest + new
        out[i] = rest
    return out


def record(rig: Rig, loads: Loads, noise_N: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """What the cell writes: times (n,) and readings (n, 6) in its own steps."""
    plan = rig.plan
    t = np.arange(round(plan.end_s * RATE_HZ)) / RATE_HZ
    signal = np.zeros((len(t), 6))
    blocks = _blocks(plan)
    starts = [plan.cases[block[0]].set_s for block in blocks]
    for block, start, end in zip(blocks, starts, [*starts[1:], plan.end_s], strict=True):
        now = _within(t, start, end)
        # The finger's weight, and how its clamps hold it.
        signal[now] += np.concatenate([rng.normal(0.0, 1.7, 3), rng.normal(0.0, 12.0, 3)])
        signal[now] += _loaded(rig, loads, block, t[now], end)
    signal[:, :3] += wander(rig, t)
    noise = _coloured(rng.standard_normal((len(t), 6)))
    signal += noise * noise_N * np.array([1.0] * 3 + [_TORQUE_MM] * 3)
    return t, np.round(signal * _STEPS) / _STEPS


def write_readings(folder: Path, t_s: Floats, signal: Floats) -> None:
    """Write `readings.csv.gz`, the same bytes each time."""
    text = io.StringIO()
    formats = ["%.4f"] + ["%.5f"] * 3 + ["%.4f"] * 3
    np.savetxt(text, np.column_stack([t_s, signal]), fmt=formats, delimiter=",", header=_HEADER, comments="")
    (folder / "readings.csv.gz").write_bytes(gzip.compress(text.getvalue().encode(), 5, mtime=0))


def _entry(case: Case) -> dict[str, Any]:
    windows = {"unloaded_s": list(case.unloaded_s), "loaded_s": list(case.loaded_s)}
    if case.unloaded_after_s is not None:
        windows["unloaded_after_s"] = list(case.unloaded_after_s)
    where = {"id": case.id, "role": case.role, "posture": case.posture, "location": case.location}
    told = {name: getattr(case, name) for name in ("setting", "mounting", "repeat_of", "direction")}
    counted = {name: value for name, value in told.items() if value is not None}
    return {**where, "masses_g": dict(case.masses_g), **windows, **counted}


def write_document(folder: Path, plan: Protocol, session_id: str) -> None:
    """Write `session.yaml`: what was meant to be set, nothing of what was really so."""
    document = {
        "format": "bench-session/1",
        "id": session_id,
        "specimen": {"id": session_id, "species": "human", "digit": "third", "side": "left"},
        "finger": "an1979_middle",
        "readings": "readings.csv.gz",
        "load_cell": {
            "model": "ATI Nano17-E SI-25-0.25",
            "rate_hz": RATE_HZ,
            "mounts": {location: {"frame": frame} for location, frame in _FRAMES.items()},
        },
        "gravity_m_s2": GRAVITY,
        "tension_factor": TENSION_FACTOR,
        "postures_deg": {name: dict(angles) for name, angles in plan.postures_deg.items()},
        "cases": [_entry(c) for c in plan.cases],
    }
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(document, Dumper=dumper, sort_keys=False, default_flow_style=None, width=110)
    (folder / "session.yaml").write_text(text, encoding="utf-8")
