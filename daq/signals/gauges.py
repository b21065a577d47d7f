"""ATI calibration files (`.cal`): six gauge voltages to a wrench, full scale, and what voltages mean saturation."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from daq.errors import DriverError
from daq.units import Kind, factor_of

Floats = NDArray[np.float64]

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
VERSIONS = ("1.0", "1.1")
# What calibration files are delivered in.
FORCES = ("N", "kN", "lbf", "lb")
TORQUES = ("Nm", "Nmm", "kNm", "lbfin", "lbin", "inlb", "lbfft", "lbft", "ftlb")
LENGTHS = ("m", "mm", "cm", "in", "ft")
# A converter's highest code lies one step below its range, of 12 bits by 0.05 %: this much of the range is its end.
END_OF_RANGE = 0.999
# The file rounds UserAxis to five decimals; Axis and scale reproduce its rows to 1e-5 of their largest number.
AGREEMENT = 1e-3
_MOST_BYTES = 1 << 20
_WHOLE = "the calibration file as the maker delivered it"


@dataclass(frozen=True, eq=False)
class GaugeCalibration:
    """Contents of a calibration file.

    Attributes:
        name: of the file.
        matrix: (6, 6) Fx Fy Fz [N], Tx Ty Tz [N mm] for each gauge's volt, in the cell's axes.
        full_scale: (6,) range of Fx Fy Fz [N], Tx Ty Tz [N mm]; certified one axis at a time.
        range_V: a gauge's voltage lies within ± this; None where the file does not say.
        limit_V: a gauge at or beyond ± this is at the end of its range; None where that is not known.
        attributes: all that the file states of sensor and calibration, as written there.
        notes: what the reader should know.
    """

    name: str
    matrix: Floats
    full_scale: Floats
    range_V: float | None
    limit_V: float | None
    attributes: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def serial(self) -> str:
        """Serial number, such as FT14048."""
        return self.attributes.get("Serial", "")

    @property
    def model(self) -> str:
        """Body and calibration, such as `ATI Nano17 SI-50-0.5`."""
        return " ".join(("ATI", self.attributes.get("BodyStyle", ""), self.attributes.get("PartNumber", ""))).strip()

    def wrench(self, volts: Floats, zero_V: Floats | None = None) -> Floats:
        """Turn gauge voltages (n, 6) into wrenches (n, 6) [N, N mm]; without a zero (6,) they keep their offset."""
        loaded = volts if zero_V is None else volts - zero_V
        # Term by term: a product of matrices rounds otherwise for one row than for many.
        out = np.zeros_like(loaded)
        for gauge in range(6):
            out += loaded[:, gauge, None] * self.matrix[:, gauge]
        return out


def saturated(volts: Floats, limit_V: float) -> NDArray[np.int64]:
    """Tell which gauges are at their limit: (n, 6) voltages to (n,) bit masks, bit 0 for the first gauge.

    The voltages are those of the converter, before any zero is taken off.
    """
    return (np.abs(volts) >= limit_V) @ (1 << np.arange(6, dtype=np.int64))


def read_calibration(path: str | Path) -> GaugeCalibration:
    """Read an ATI calibration file of version 1.0 or 1.1.

    Raises:
        DriverError: it cannot be read, is of another version or unit, lacks rows, or contradicts itself.
    """
    file = Path(path)
    root = _root(file)
    found = root.find("Calibration")
    if root.tag != "FTSensor" or found is None:
        raise DriverError(f"{file.name} holds <{root.tag}>", "an ATI calibration (FTSensor with Calibration)")
    stated = {**root.attrib, **found.attrib}
    if stated.get("CalFileVersion") not in VERSIONS:
        raise DriverError(
            f"{file.name} is of CalFileVersion {stated.get('CalFileVersion')}", f"version {' or '.join(VERSIONS)}"
        )
    for name, wanted in (("NumGages", 6.0), ("GainMultiplier", 1.0)):
        if name in stated and _numbers(file, name, stated[name], 1)[0] != wanted:
            raise DriverError(f"{file.name}: {name} is {stated[name]}", f"{wanted:g}", "Others are not understood")
    force = _unit(file, stated, "ForceUnits", "force", FORCES)
    torque = _unit(file, stated, "TorqueUnits", "torque", TORQUES)
    factors = np.repeat([force, torque], 3)
    axis, user = _rows(file, found, "Axis"), _rows(file, found, "UserAxis")
    if not axis and not user:
        raise DriverError(f"{file.name} has no rows", "six Axis or UserAxis rows", f"Use {_WHOLE}")
    if stated["CalFileVersion"] != "1.0" and not user:
        raise DriverError(f"{file.name} lacks UserAxis rows", "six of them in version 1.1", f"Use {_WHOLE}")
    from_axis, why_not = _transformed(file, found, axis, stated, factors)
    if user:
        matrix = factors[:, None] * np.array([_numbers(file, "values", user[a].get("values"), 6) for a in AXES])
        if from_axis is not None:
            _agree(file, matrix, from_axis)
    elif from_axis is not None:
        matrix = from_axis
    else:
        raise DriverError(f"{file.name}: {why_not}", "UserAxis rows, or a shift alone", "Ask the maker for version 1.1")
    rows = user or axis
    full_scale = factors * np.array([_numbers(file, "max", rows[a].get("max"), 1)[0] for a in AXES])
    if np.linalg.matrix_rank(matrix) < 6 or not (full_scale > 0.0).all():
        raise DriverError(f"{file.name} does not tell six axes apart", _WHOLE)
    range_V, notes = _range(file, stated)
    limit_V = None if range_V is None else END_OF_RANGE * range_V
    return GaugeCalibration(file.name, matrix, full_scale, range_V, limit_V, stated, notes)


def _root(file: Path) -> ET.Element:
    try:
        with file.open("rb") as stream:
            content = stream.read(_MOST_BYTES)
    except OSError as error:
        raise DriverError(
            f"{file.name} cannot be read ({error.strerror})", "a calibration file (.cal)", "Check the path"
        ) from error
    # Entities are of no use in a calibration, and can be made to grow without bound.
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise DriverError(f"{file.name} declares its own markup", _WHOLE)
    try:
        return ET.fromstring(content)  # noqa: S314 - bounded, and without entities
    except (ET.ParseError, ValueError, LookupError) as error:
        raise DriverError(f"{file.name} is not XML ({error})", _WHOLE, "Copy it again") from error


def _numbers(file: Path, what: str, text: str | None, count: int) -> Floats:
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise DriverError(f"{file.name}: {what} is {text!r}", wanted, f"Use {_WHOLE}")
    return values


def _unit(file: Path, stated: Mapping[str, str], name: str, kind: Kind, known: Sequence[str]) -> float:
    unit = re.sub(r"[\s_.*·⋅-]", "", stated.get(name, ""))
    factor = factor_of(unit, kind) if unit in known else None
    if factor is None:
        found = f"{name} is {stated[name]!r}" if name in stated else f"it states no {name}"
        raise DriverError(f"{file.name}: {found}", f"one of {' '.join(known)}", "Have it exported in one of these")
    return factor


def _rows(file: Path, found: ET.Element, tag: str) -> dict[str, ET.Element]:
    """Return rows by axis: all six, or none at all."""
    rows = found.findall(tag)
    names = [row.get("Name", "") for row in rows]
    if rows and sorted(names) != sorted(AXES):
        missing = [a for a in AXES if a not in names]
        what = f"lacks {tag} {' '.join(missing)}" if missing else f"has {tag} rows {' '.join(names)}"
        raise DriverError(f"{file.name} {what}", f"{tag} rows {' '.join(AXES)}, each once", f"Use {_WHOLE}")
    return dict(zip(names, rows, strict=True))


def _transformed(
    file: Path,
    found: ET.Element,
    axis: Mapping[str, ET.Element],
    stated: Mapping[str, str],
    factors: Floats,
) -> tuple[Floats | None, str]:
    """Return axis / scale, then torque −= d × force; or None and why not."""
    if not axis:
        return None, "no Axis rows"
    values = np.array([_numbers(file, f"values of {a}", axis[a].get("values"), 6) for a in AXES])
    scale = np.array([_numbers(file, f"scale of {a}", axis[a].get("scale"), 1)[0] for a in AXES])
    if not (scale > 0.0).all():
        raise DriverError(f"{file.name}: a scale is {scale.min():g}", "scales above zero", f"Use {_WHOLE}")
    matrix = factors[:, None] * values / scale[:, None]
    shift = found.find("BasicTransform")
    if shift is None:
        return None, "it states no BasicTransform"
    moved = {k: _numbers(file, k, shift.get(k, "0"), 1)[0] for k in ("Dx", "Dy", "Dz", "Rx", "Ry", "Rz")}
    if any(moved[k] != 0.0 for k in ("Rx", "Ry", "Rz")):
        # In which order the three turn is not known.
        return None, "its BasicTransform turns the axes"
    d_mm = np.array([moved[k] for k in ("Dx", "Dy", "Dz")])
    if d_mm.any():
        d_mm = d_mm * _unit(file, stated, "DistUnits", "length", LENGTHS)
    matrix[3:] -= np.cross(d_mm, matrix[:3].T).T
    return matrix, ""


def _agree(file: Path, user: Floats, from_axis: Floats) -> None:
    off = np.abs(user - from_axis).max(axis=1) / np.abs(user).max(axis=1).clip(min=1e-300)
    worst = int(np.argmax(off))
    if off[worst] > AGREEMENT:
        raise DriverError(
            f"{file.name}: UserAxis {AXES[worst]} is off Axis, scale and BasicTransform by {100.0 * off[worst]:.2g} %",
            f"the same to {100.0 * AGREEMENT:g} %",
            f"Was it edited? Use {_WHOLE}",
        )


def _range(file: Path, stated: Mapping[str, str]) -> tuple[float | None, tuple[str, ...]]:
    """Return half the output range, and what is missing for it."""
    notes = []
    if stated.get("HWTempComp", "true").lower() != "true":
        notes.append("HWTempComp is false: what temperature does to the gauges is not taken out")
    if "OutputRange" not in stated:
        return None, (*notes, "it states no OutputRange: saturation needs a limit")
    span = float(_numbers(file, "OutputRange", stated["OutputRange"], 1)[0])
    if not span > 0.0:
        raise DriverError(f"{file.name}: OutputRange is {span:g}", "volts above zero", f"Use {_WHOLE}")
    if stated.get("OutputBipolar", "true").lower() != "true":
        return None, (*notes, "its output is not bipolar: saturation needs a limit")
    return span / 2.0, tuple(notes)


def voltages(text: str, what: str) -> Floats:
    """Read six voltages (6,) [V] from a setting's text.

    Raises:
        DriverError: they are not six finite numbers.
    """
    words: Sequence[str] = text.replace(",", " ").split()
    try:
        values = np.array([float(w) for w in words])
    except ValueError:
        values = np.zeros(0)
    if len(values) != 6 or not np.isfinite(values).all():
        raise DriverError(f"{what} is {text!r}", "six voltages with spaces between them")
    return values
