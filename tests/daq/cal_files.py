"""Calibration files for tests, written from the numbers of real ones."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import yaml

TRUTH = Path(__file__).parents[1] / "truth" / "ati_calibrations.yaml"
SIX = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")


def numbers(name: str) -> dict[str, Any]:
    """What one of the real files says."""
    found: dict[str, Any] = yaml.safe_load(TRUTH.read_text("utf-8"))[name]
    return copy.deepcopy(found)


def write_cal(path: Path, truth: dict[str, Any]) -> Path:
    """Write a file in the maker's form."""
    of_sensor = ("Serial", "BodyStyle", "Family", "NumGages", "CalFileVersion")
    given = truth["attributes"]

    def attributes(names: list[str]) -> str:
        return " ".join(f'{n}="{given[n]}"' for n in names)

    def row(tag: str, axis: str, more: str = "") -> str:
        values = "  ".join(f"{v:.5f}" for v in truth[tag][axis])
        full = truth["max"][SIX.index(axis)]
        name = {"axis": "Axis", "user_axis": "UserAxis"}[tag]
        return f'<{name} Name="{axis}" values=" {values} " max="{full}" {more}/>'

    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<!-- written by a test -->"]
    lines.append(f"<FTSensor {attributes([n for n in of_sensor if n in given])}>")
    lines.append(f"<Calibration {attributes([n for n in given if n not in of_sensor])}>")
    lines += [row("axis", a, f'scale="{truth["scale"][SIX.index(a)]}"') for a in truth.get("axis", {})]
    six = zip(("Dx", "Dy", "Dz", "Rx", "Ry", "Rz"), truth["basic_transform"], strict=True)
    shift = " ".join(f'{n}="{v}"' for n, v in six)
    lines.append(f"<BasicTransform {shift}/>")
    lines += [row("user_axis", a) for a in truth.get("user_axis", {})]
    path.write_text("\n".join([*lines, "</Calibration>", "</FTSensor>"]), "utf-8")
    return path


def nano17(folder: Path) -> Path:
    """The Nano17's file."""
    return write_cal(folder / "FT14048.cal", numbers("nano17_FT14048"))
