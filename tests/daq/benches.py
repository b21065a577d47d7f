"""Small benches for the tests: sessions as plain data, and recordings of known wrenches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from daq.recordings.readings import ReadingBlock, write_readings
from daq.sessions import Session, read_session

Floats = NDArray[np.float64]

RATE_HZ = 100.0
SEGMENT_S = 4.0
MARGIN_S = 0.5
WRENCH = np.array([-0.5, -2.1, 0.3, 1.0, -0.7, 20.0])


def averaged() -> dict[str, Any]:
    """A session of two averaged forces."""
    return {
        "format": "bench-session/1",
        "id": "S1",
        "specimen": {"id": "P1", "species": "human", "digit": "third", "side": "left"},
        "finger": "an1979_middle",
        "load_cell": {"model": "ATI Nano17-E SI-25-0.25", "mounts": {"tip": {}, "bone": {}}},
        "gravity_m_s2": 9.81,
        "tension_factor": 0.835,
        "postures_deg": {
            "hook": {"MCP": 0, "PIP": 65, "DIP": 50, "abduction": 0},
            "minor_flexion": {"MCP": 40, "PIP": 55, "DIP": 35},
        },
        "cases": [
            {
                "id": "c001",
                "role": "identification",
                "posture": "hook",
                "location": "tip",
                "masses_g": {"FDP": 950.0},
                "force_N": [-0.9, -2.0, 0.05],
            },
            {
                "id": "c002",
                "role": "validation",
                "posture": "minor_flexion",
                "location": "bone",
                "masses_g": {"FDP": 300, "FDS": 300},
                "force_N": [4.21, 0.004, 0.213],
            },
        ],
    }


def recorded(cases: int = 1, after: bool = False) -> dict[str, Any]:
    """A session with windows: tare and load in turn, and with `after` a tare after each load as well."""
    data = averaged()
    data["readings"] = "readings.csv"
    data["load_cell"]["rate_hz"] = RATE_HZ
    data["cases"] = []
    for i in range(cases):
        case = {
            "id": f"c{i + 1:03d}",
            "role": "identification" if i % 2 == 0 else "validation",
            "posture": "hook" if i % 2 == 0 else "minor_flexion",
            "location": "tip",
            "masses_g": {"FDP": 950.0},
            "unloaded_s": window(2 * i),
            "loaded_s": window(2 * i + 1),
        }
        if after:
            case["unloaded_after_s"] = window(2 * i + 2)
        data["cases"].append(case)
    return data


def window(segment: int) -> list[float]:
    """The middle of a segment of the recording."""
    return [segment * SEGMENT_S + MARGIN_S, (segment + 1) * SEGMENT_S - MARGIN_S]


def record(
    levels: Sequence[Floats],
    noise: float = 0.0,
    drift: Callable[[Floats], Floats] | None = None,
    seed: int = 0,
) -> ReadingBlock:
    """A recording that holds each level (6,) for a segment, with white noise and a drift (n,) -> (n, 6)."""
    n = round(SEGMENT_S * RATE_HZ)
    t = np.arange(n * len(levels)) / RATE_HZ
    w = np.repeat(np.array(levels, dtype=float), n, axis=0)
    if noise:
        w = w + noise * np.random.default_rng(seed).normal(size=w.shape)
    if drift is not None:
        w = w + drift(t)
    return ReadingBlock(t, w)


def creeping(share: float) -> tuple[dict[str, Any], ReadingBlock]:
    """A session of eight loads that creep by a share of their force within a segment, and its recording."""
    levels = [(k % 2) * (1.0 + k) * 0.2 * WRENCH for k in range(16)]

    def creep(t: Floats) -> Floats:
        segment = t / SEGMENT_S
        whole = segment.astype(int)
        return share * np.array(levels)[whole] * (segment - whole - 0.5)[:, None]

    return recorded(8), record(levels, noise=0.02, drift=creep)


def in_blocks(block: ReadingBlock, rows: int) -> Iterator[ReadingBlock]:
    """Cut a recording."""
    for start in range(0, len(block), rows):
        cut = slice(start, start + rows)
        yield ReadingBlock(block.t_s[cut], block.wrench[cut], None if block.status is None else block.status[cut])


def bench(folder: Path, data: dict[str, Any], *blocks: ReadingBlock) -> Session:
    """Write a session and its readings, and read it back."""
    save(folder, data, *blocks)
    return read_session(folder)


def save(folder: Path, data: dict[str, Any], *blocks: ReadingBlock) -> Path:
    """Write a session and its readings."""
    folder.mkdir(parents=True, exist_ok=True)
    if blocks:
        write_readings(folder / data["readings"], blocks)
    (folder / "session.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return folder


def averaged_of_many(name: str, count: int) -> dict[str, Any]:
    """The same with so many load cases, each with a force and its uncertainty."""
    data, rng = averaged() | {"id": name}, np.random.default_rng(0)
    data["cases"] = [
        data["cases"][0]
        | {
            "id": f"c{i:05d}",
            "role": "validation" if i % 3 == 0 else "identification",
            "location": ("tip", "bone")[i % 2],
            "posture": ("hook", "minor_flexion")[i // 2 % 2],
            "masses_g": {"FDP": float(rng.integers(100, 900))},
            "force_N": rng.normal(size=3).tolist(),
            "force_sd_N": [0.02] * 3,
        }
        for i in range(count)
    ]
    return data
