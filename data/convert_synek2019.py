"""Turn the published measurements of Synek et al. 2019 into bench sessions, one a specimen and one of the human mean.

    python data/convert_synek2019.py

reads `data/reference/synek2019/*.csv` and writes `data/sessions/synek2019_*/session.yaml`.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from daq.sessions import FORMAT, Session, parse_session, write_session

HERE = Path(__file__).resolve().parent
REFERENCE = HERE / "reference" / "synek2019"
HUMANS = ("H01", "H02", "H03")
MEAN = "HMEAN"
POSTURES = {
    "MinorFlex": "minor_flexion",
    "MajorFlex": "major_flexion",
    "HyperExt": "hyperextension",
    "Hook": "hook",
}
# Table 2, but minor flexion was done, and computed, with the PIP at 55°, not 45°.
ANGLES_DEG: Mapping[str, Mapping[str, float]] = {
    "minor_flexion": {"MCP": 40.0, "PIP": 55.0, "DIP": 35.0, "abduction": 0.0},
    "major_flexion": {"MCP": 55.0, "PIP": 57.0, "DIP": 25.0, "abduction": 0.0},
    "hyperextension": {"MCP": -20.0, "PIP": 50.0, "DIP": 45.0, "abduction": 0.0},
    "hook": {"MCP": 0.0, "PIP": 65.0, "DIP": 50.0, "abduction": 0.0},
}
BONOBO_MAJOR_DEG: Mapping[str, float] = {"MCP": 60.0, "PIP": 50.0, "DIP": 40.0, "abduction": 0.0}
TENDONS = ("RI", "LU", "UI", "FDP", "FDS", "EDC")
NOTES = (
    "force_N: loaded less unloaded, in right-hand-equivalent axes of the distal phalanx (tip) or metacarpal (bone)",
    "no uncertainties were published",
    "minor flexion has the PIP at 55 degrees, as it was done and computed; Table 2 of the paper prints 45",
    "RI and UI: both sutures of a muscle where it has two, loads and forces summed by the authors",
    "the specimens are left hands; whether the authors mirrored the radial component is not documented",
)


def cases_of(specimen: str) -> list[dict[str, Any]]:
    """Return a specimen's load cases in the order of the published files: single tendons, then both flexors."""
    out = []
    for row in _rows(f"Fingertip_forces__{specimen}_fingertip_summed.csv"):
        force = [float(row[f"Ftip_{axis}"]) for axis in ("PD", "DV", "RU")]
        out.append(_case("identification", row["Posture"], "tip", {row["Muscle"]: float(row["Load"])}, force))
    for name, location, prefix in (
        (f"Fingertip_forces__{specimen}_fingertip_combined.csv", "tip", "Ftip"),
        (f"Mc_forces__{specimen}_mcforce_combined.csv", "bone", "Fmc"),
    ):
        for row in _rows(name):
            masses = {t: float(row[t]) for t in TENDONS if float(row[t]) > 0.0}
            force = [float(row[f"{prefix}_{axis}"]) for axis in ("PD", "DV", "RU")]
            out.append(_case("validation", row["Posture"], location, masses, force))
    return out


def mean_of(groups: Sequence[Sequence[Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """Return load cases whose forces are the arithmetic mean of those of the same cases in several specimens."""
    out = []
    for same in zip(*groups, strict=True):
        if len({case["id"] for case in same}) != 1:
            raise ValueError(f"cases differ: {[case['id'] for case in same]}")
        force = [sum(case["force_N"][k] for case in same) / len(same) for k in range(3)]
        out.append({**same[0], "force_N": force})
    return out


# A mean of three specimens scatters by 1/√3 of one: reading 0.08 N, friction 6 % and 2.5 %, joint angles 3°.
MEAN_BUDGET = {
    "base": "synek2019",
    "reading_sd_N": 0.046,
    "tension_factor_common_sd": 0.035,
    "tension_factor_case_sd": 0.0144,
    "angle_sd_deg": 1.73,
}


def session_of(specimen: str, cases: Sequence[Mapping[str, Any]]) -> Session:
    """Return the session of a specimen, or of the human mean."""
    bonobo = specimen.startswith("B")
    members = HUMANS if specimen == MEAN else (specimen,)
    angles = {k: dict(v) for k, v in ANGLES_DEG.items()}
    if bonobo:
        angles["major_flexion"] = dict(BONOBO_MAJOR_DEG)
    provenance: dict[str, Any] = {
        "source": "Synek, Lu, Vereecke, Nauwelaerts, Kivell, Pahr 2019, PeerJ 7:e7470, Dataset S1",
        "doi": "10.7717/peerj.7470",
        "licence": "CC BY 4.0",
        "files": [p.name for m in members for p in sorted(REFERENCE.glob(f"*__{m}_*.csv"))],
        "converted_by": "data/convert_synek2019.py",
        "notes": list(NOTES),
    }
    if specimen == MEAN:
        provenance["mean_of"] = [f"synek2019_{m}" for m in members]
    data = {
        "format": FORMAT,
        "id": f"synek2019_{specimen}",
        "specimen": {
            "id": specimen,
            "species": "bonobo" if bonobo else "human",
            "digit": "third",
            "side": "left",
            "preservation": "fresh frozen",
        },
        "finger": "synek2019_bonobo" if bonobo else "synek2019_initial",
        "load_cell": {
            "model": "ATI Nano17-E",
            "mounts": {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}},
        },
        "gravity_m_s2": 9.81,
        "tension_factor": 0.835,
        "postures_deg": angles,
        "cases": list(cases),
        "budget": MEAN_BUDGET if specimen == MEAN else "synek2019",
        "provenance": provenance,
    }
    session, faults = parse_session(data, None, f"synek2019_{specimen}")
    if session is None:
        raise faults[0]
    return session


def main() -> None:
    """Write the five sessions."""
    groups = {specimen: cases_of(specimen) for specimen in (*HUMANS, "B01")}
    groups[MEAN] = mean_of([groups[m] for m in HUMANS])
    for specimen, cases in groups.items():
        write_session(session_of(specimen, cases), HERE / "sessions" / f"synek2019_{specimen}")


def _rows(name: str) -> list[dict[str, str]]:
    with (REFERENCE / name).open(newline="", encoding="utf-8-sig") as file:
        return list(csv.DictReader(file))


def _case(
    role: str, posture: str, location: str, masses_g: Mapping[str, float], force_N: list[float]
) -> dict[str, Any]:
    weights = "-".join(f"{tendon}-{mass:g}" for tendon, mass in masses_g.items())
    return {
        "id": f"{POSTURES[posture]}-{weights}-{location}",
        "role": role,
        "posture": POSTURES[posture],
        "location": location,
        "masses_g": dict(masses_g),
        "force_N": force_N,
    }


if __name__ == "__main__":
    main()
