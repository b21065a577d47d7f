"""The folder of a session: readings of a noisy cell through all load cases, and what the file says was done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import yaml

from tests.random_worlds.protocols import Case, Plan, Rng
from tests.random_worlds.visibility import Noise
from tests.simulator.finger import DATA, Floats
from tests.simulator.recording import COLUMNS, RATE_HZ, REST, STEP, settling

TORQUE_MM = 6.7
_FRAMES = {"tip": "distal_phalanx", "bone": "metacarpal"}


def write_readings(
    folder: Path, plan: Plan, loads: Floats, wander: Callable[[Floats], Floats], noise: Noise, rng: Rng
) -> None:
    """Write `readings.parquet`.

    Args:
        folder: of the session.
        plan: whose cases are loaded one after another.
        loads: (cases, 6) what the cell reads of each load [N, N mm], drift and noise apart.
        wander: of times (n,), adds (n, 6) by the clock.
        noise: of each reading, and of each case as a whole.
        rng: of the noise and of the unloaded readings.
    """
    t = np.arange(round(plan.end_s * RATE_HZ) + 1) / RATE_HZ
    unit = np.array([1.0] * 3 + [TORQUE_MM] * 3)
    held = loads + noise.case_N * unit * _heavy(rng, noise.dof, loads.shape)
    starts, levels, swings = [0.0], [np.zeros(6)], [0.0]
    rest, block = np.zeros(6), -1
    for case, load in zip(plan.cases, held, strict=True):
        if case.block != block:
            # The finger's weight and how its clamps hold it; by then the posture is set and nothing swings.
            block, rest = case.block, rng.normal(size=6) * REST
            starts.append(case.set_s)
            levels.append(rest)
            swings.append(0.0)
        starts.append(case.hung_s)
        levels.append(rest + load)
        swings.append(1.0)
    signal = settling(t, starts, levels, swings) + wander(t)
    signal += noise.reading_N * unit * rng.normal(size=signal.shape)
    if noise.reading_N:
        signal = np.round(signal / STEP) * STEP
    table = pa.table(dict(zip(COLUMNS, [np.round(t, 4), *signal.T], strict=True)))
    pa.parquet.write_table(table, folder / "readings.parquet", compression="zstd")


def write_document(folder: Path, plan: Plan, stated: Sequence[Case], scale: float, side: str, name: str) -> None:
    """Write `session.yaml`, and `finger.yaml` where the finger is not the published one's size.

    Args:
        folder: of the session.
        plan: its postures and tension factor.
        stated: the cases as the file has them, slips and all.
        scale: of all the finger's lengths.
        side: left or right; the readings are those of a right hand either way.
        name: of session and specimen.
    """
    document: dict[str, Any] = {
        "format": "bench-session/1",
        "id": name,
        "specimen": {"id": name, "species": "human", "digit": "third", "side": side},
        "finger": "an1979_middle" if scale == 1.0 else "finger.yaml",
        "readings": "readings.parquet",
        "load_cell": {
            "model": "ATI Nano17-E SI-25-0.25",
            "rate_hz": RATE_HZ,
            "mounts": {place: {"frame": _FRAMES[place]} for place in dict.fromkeys(c.location for c in stated)},
        },
        "gravity_m_s2": 9.81,
        "tension_factor": plan.tension_factor,
        "postures_deg": {n: dict(p) for n, p in plan.postures_deg.items()},
        "cases": [_entry(c) for c in stated],
    }
    _write(folder / "session.yaml", document)
    if scale != 1.0:
        text = (DATA / "fingers" / "an1979_middle.yaml").read_text(encoding="utf-8")
        finger = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 - safe either way
        finger["id"] = "finger"
        finger["length_unit"]["value_mm"] *= scale
        finger["load_point"]["offset_mm"] = [x * scale for x in finger["load_point"]["offset_mm"]]
        _write(folder / "finger.yaml", finger)


def _heavy(rng: Rng, dof: int | None, shape: tuple[int, ...]) -> Floats:
    """Numbers of scale one: Gaussian, or Student's with few degrees of freedom."""
    out: Floats = rng.normal(size=shape) if dof is None else rng.standard_t(dof, size=shape)
    return out


def _entry(case: Case) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": case.id, "role": case.role, "posture": case.posture, "location": case.location}
    entry |= {"masses_g": dict(case.masses_g), "unloaded_s": list(case.unloaded_s), "loaded_s": list(case.loaded_s)}
    entry |= {"setting": case.setting} if case.setting else {}
    return entry | ({"repeat_of": case.repeat_of} if case.repeat_of else {})


def _write(file: Path, document: dict[str, Any]) -> None:
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(document, Dumper=dumper, sort_keys=False, default_flow_style=None, width=110)
    file.write_text(text, encoding="utf-8")
