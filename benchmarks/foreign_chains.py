"""Random finger chains of MuJoCo and OpenSim, wraps on every side: are moment arms theirs, or is the error said?

    python -m benchmarks.foreign_chains [--chains 200] [--out FILE]

Each chain has three hinges and six tendons, every one with a cylinder or sphere of its own: centred or not, tilted or
not, on either bone, held on either side, inside or not at all. An import is held against the engine in postures that
it has not seen. Writes `benchmarks/foreign_chains.md`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.machine import commit, publish
from fingermodel.exchange.arm_formulas import formula_arms
from fingermodel.exchange.joint_heads import NOTHING_MM
from fingermodel.exchange.read_mjcf import read_mjcf
from fingermodel.exchange.read_osim import read_osim
from tests.fingermodel.foreign_chains import (
    TENDONS,
    arms_in_mujoco,
    arms_in_opensim,
    mjcf_chain,
    osim_chain,
    postures_drawn,
)

POSTURES = {"MuJoCo": 300, "OpenSim": 60}


def held(kind: str, seed: int, folder: Path) -> list[tuple[float, float]]:
    """Error found and error stated of every tendon [mm]."""
    rng = np.random.default_rng(seed)
    path = folder / f"chain.{'xml' if kind == 'MuJoCo' else 'osim'}"
    path.write_text((mjcf_chain if kind == "MuJoCo" else osim_chain)(rng), encoding="utf-8")
    imported = (read_mjcf if kind == "MuJoCo" else read_osim)(path, "benchmark")
    assert imported.check is not None
    postures = postures_drawn(rng, POSTURES[kind])
    theirs = arms_in_mujoco(path.read_text("utf-8"), postures) if kind == "MuJoCo" else arms_in_opensim(path, postures)
    slips = [s.slip for s in imported.finger.topology.segments]
    ours = formula_arms(imported.finger, postures)[:, :, [slips.index(name) for name in TENDONS]]
    found = np.abs(theirs - ours).max(axis=(0, 1))
    return [(float(found[i]), imported.check.worst_mm[name]) for i, name in enumerate(TENDONS)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--chains", type=int, default=200)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    options = parser.parse_args()
    lines = ["# Imported chains against the engines that they were made for", "", f"Commit {commit()}.", ""]
    lines += [
        "| engine | chains | tendons | the engine's to 1e-6 mm | error said | error not said | said / found, least |"
    ]
    lines += ["|---|---|---|---|---|---|---|"]
    for kind in ("MuJoCo", "OpenSim"):
        begun = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            pairs = np.array([pair for seed in range(options.chains) for pair in held(kind, seed, Path(folder))])
        found, said = pairs.T
        off, told = found > NOTHING_MM, said > NOTHING_MM
        ratio = float((said[off & told] / found[off & told]).min()) if (off & told).any() else 1.0
        counts = f"{np.sum(~off & ~told)} | {np.sum(told)} | {np.sum(off & ~told)}"
        lines.append(f"| {kind} | {options.chains} | {len(pairs)} | {counts} | {ratio:.2f} |")
        print(lines[-1], f"{time.perf_counter() - begun:.0f} s")
    lines += [
        "",
        f"Found over {POSTURES['MuJoCo']} and {POSTURES['OpenSim']} random postures, other than those of the import.",
    ]
    publish(options.out, lines)


if __name__ == "__main__":
    main()
