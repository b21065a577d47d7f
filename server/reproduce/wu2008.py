"""Wu et al. 2008 (J Biomech 41:668–676), an index finger that taps: every published figure beside ours.

The inputs are those of the authors' later model in the AnyBody managed model repository (AMMR), whose output is set
beside ours as well; it differs from the paper's own figures.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.locations import data_dir
from fingermodel.dynamics.inertia import SegmentShape, read_segments
from fingermodel.dynamics.motion import Motion, read_motion
from fingermodel.fingers.files import read_finger
from fingermodel.muscles.muscle_files import read_muscles
from fingermodel.studies.movement import MovementResult, work_out
from fingermodel.studies.published import Row, row, row_about, row_within
from server.figures.movement import Reference, movement_plots
from server.figures.plot import Plot
from server.reproduce.printed import reference, rows_beside
from server.reproduce.study import Line, Progress, Reproduction, Sheet

Floats = NDArray[np.float64]
FINGER, MOTION = "wu2008_index", "wu2008_tap"
# Our names of the muscles, and theirs in AMMR's output.
AMMR = {"FDP": "FP", "FDS": "FS", "EC": "EC", "EI": "EI", "RI": "RI", "UI": "UI", "LU": "LU"}
FROM_S, TO_S, STEPS = -0.06, 0.24, 301
OTHER_INPUT = (
    "paper and AMMR differ: for these inputs the authors' later model gives FP 2.40 N and FS 1.80 N (sheet below); its "
    "header says that results may differ from the paper because of a newer recruitment solver"
)
READINGS = "the wording allows the passive force at the muscle's peak, and the greatest passive force, over that peak"
MEASURED = "quoted in the paper, which finds itself consistent with it: mean and spread of measured tensions"
REST = (
    "our muscles at rest hold the finger against gravity and against the passive RI and UI, so FDS is active throughout"
)
TORQUES = "not available: the torques of Jindrich et al. 2004 and the paper's own are in figures alone"
AROUND = "'around' is taken as within 10 ms, 'shortly before' as from 50 ms before to 10 ms after"


def reproduce(progress: Progress) -> Reproduction:
    """Recompute the study."""
    result = tap("wu2008", FROM_S)
    progress(0.4)
    later = tap("wu2008_ammr", 0.0, steps=40)
    rows = [*_inertia_rows(), *_peak_rows(result), *_order_rows(result), *_passive_rows(result)]
    rows += rows_beside(reference("wu2008")["torques"], {}, TORQUES)
    progress(0.6)
    sheets = (_settings(result), _directions(), _beside_ammr(later))
    progress(1.0)
    return Reproduction(
        rows=tuple(rows),
        assumptions=tuple(reference("wu2008")["assumptions"]),
        sheets=sheets,
        results={"peaks": result.peaks(), "peaks_with_ammr_muscles": later.peaks()},
        plots=_plots,
    )


def tap(
    muscles: str,
    from_s: float = FROM_S,
    steps: int = STEPS,
    *,
    gravity: bool = True,
    curve: tuple[str, int] | None = None,
    turned_deg: float = 0.0,
) -> MovementResult:
    """Return the tap, from a time on, with a set of muscles; see `fingermodel.studies.movement.work_out`.

    `turned_deg` turns tip force and gravity from dorsal and palmar to distal and proximal, as if the metacarpal rose
    towards the finger.
    """
    finger = read_finger(FINGER)
    motion = _turned(replace(read_motion(MOTION), span_s=(from_s, TO_S)), np.deg2rad(turned_deg))
    return work_out(motion, finger, read_muscles(muscles, finger), steps, gravity=gravity, curve=curve)


def _turned(motion: Motion, angle_rad: float) -> Motion:
    if angle_rad == 0.0:
        return motion
    sine, cosine = float(np.sin(angle_rad)), float(np.cos(angle_rad))
    block = motion.document.tip_force
    assert block is not None  # noqa: S101 - the tap has a force
    up = np.array(block.components["Fy_N"])
    components = {"Fx_N": (-sine * up).tolist(), "Fy_N": (cosine * up).tolist()}
    document = motion.document.model_copy(update={"tip_force": block.model_copy(update={"components": components})})
    x, y, z = motion.gravity_mm_s2
    gravity = np.array([cosine * x - sine * y, sine * x + cosine * y, z])
    return replace(motion, document=document, gravity_mm_s2=gravity)


@cache
def ammr_output() -> dict[str, Floats]:
    """Return AMMR's output over time, by column [s, m, N]."""
    with (data_dir() / "reference" / "wu2008_ammr" / "tap.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    return {name: np.array([float(line[name]) for line in lines]) for name in lines[0]}


def _plots() -> list[Plot]:
    output = ammr_output()
    forces = {ours: output[f"{theirs}_Ft_N"] for ours, theirs in AMMR.items()}
    return movement_plots(tap("wu2008"), Reference("AMMR's output", output["t_s"], forces))


def _inertia_rows() -> Iterator[Row]:
    for shape in read_segments("wu2008"):
        name, mass, *moments = reference("wu2008")["table_1b"][shape.bone]
        ours = shape.inertia()
        low, high = _mass_range_g(shape)
        rounded = abs(1e3 * ours.mass_kg - float(mass)) <= 0.5 * 10.0 ** -len(mass.partition(".")[2])
        note = "" if rounded else f"the dimensions as printed, to 0.01 mm, allow {low:.3f} to {high:.3f} g"
        yield row(f"mass, {name} segment", mass, 1e3 * ours.mass_kg, "g", note)
        for axis, text, value in zip("xyz", moments, ours.moments_kg_mm2, strict=True):
            yield row(f"I_{axis}{axis}, {name} segment", text, float(value), "kg mm²")


def _mass_range_g(shape: SegmentShape) -> tuple[float, float]:
    """Return least and greatest mass that dimensions rounded to 0.01 mm allow [g]."""
    masses = []
    for signs in product((-0.005, 0.005), repeat=3):
        parts = [
            type(c)(c.half_width_mm + d, c.half_depth_mm + d, c.length_mm + d)
            for c, d in zip((shape.tissue, shape.cortex, shape.canal), signs, strict=True)
        ]
        masses.append(1e3 * replace(shape, tissue=parts[0], cortex=parts[1], canal=parts[2]).inertia().mass_kg)
    return min(masses), max(masses)


def _peak_rows(result: MovementResult) -> list[Row]:
    tip = float(np.linalg.norm(result.tip_force_N, axis=1).max())
    peak = {p["muscle"]: p["peak_N"] for p in result.peaks()}
    return [
        row("peak force at the fingertip", "1.31", tip, "N"),
        row("peak force of FS (FDS)", "1.24", peak["FDS"], "N", OTHER_INPUT),
        row("peak force of FP (FDP)", "3.80", peak["FDP"], "N", OTHER_INPUT),
        row("peak of FS over peak at the fingertip", "0.95", peak["FDS"] / tip, "1", OTHER_INPUT),
        row("peak of FP over peak at the fingertip", "2.9", peak["FDP"] / tip, "1", OTHER_INPUT),
        row_about("FS over fingertip, measured by Kursa et al. 2005", "1.5", "1.0", peak["FDS"] / tip, "1", MEASURED),
        row_about("FP over fingertip, measured by Kursa et al. 2005", "2.4", "0.7", peak["FDP"] / tip, "1", MEASURED),
    ]


def _order_rows(result: MovementResult) -> Iterator[Row]:
    """Yield rows on the order in time; a row's figure is a time, or a share where the paper speaks of size."""
    times, contact = result.times_s, result.contact_s()
    assert contact is not None  # noqa: S101 - the tap has a force
    first, last = contact
    rate = result.rate_rad_s[:, result.rotations.index("MCP")]
    downswing = float(times[np.flatnonzero(rate > 0.1 * rate.max())[0]])
    active = {m: result.active_N[:, i] for i, m in enumerate(result.muscles)}
    total = {m: result.force[:, i] for i, m in enumerate(result.muscles)}

    def statement(quantity: str, printed: str, ours: float, unit: str, holds: bool, note: str = "") -> Row:
        return Row(quantity, None, ours, unit, bool(holds), note, printed)

    yield row_about("contact of fingertip and key", "0.180", "0.010", last - first, "s", AROUND)
    for m in ("EC", "EI"):
        on = float(times[np.flatnonzero(active[m] > 0.1 * active[m].max())[0]])
        yield statement(f"{m} becomes active", f"before the downswing ({downswing:.3f})", on, "s", on < downswing, REST)
    for m in ("FDS", "FDP", "UI", "RI"):
        on = float(times[np.flatnonzero(active[m] > 0.5 * active[m].max())[0]])
        printed, why = f"shortly before contact ({first:.3f})", f"{AROUND}; {REST}"
        yield statement(f"{m} exceeds half of its peak", printed, on, "s", -0.05 <= on - first <= 0.01, why)
    for m in ("FDP", "FDS", "UI", "RI"):
        at = float(times[total[m].argmax()])
        yield statement(f"peak of {m}", f"in contact ({first:.3f} to {last:.3f})", at, "s", first <= at <= last)
    for m in ("EC", "EI"):
        at = float(times[total[m].argmax()])
        yield statement(f"peak of {m}", "before or after contact", at, "s", not first <= at <= last)
        again = float(active[m][times > last].max() / active[m].max())
        yield statement(f"{m} after contact, over its peak", "active again", again, "1", again > 0.1)
    early, late = (times >= first) & (times <= first + 0.03), (times > first + 0.03) & (times <= last)
    for name, near, within in (("second", 0.05, early), ("third", 0.11, late)):
        at = float(times[within][total["FDP"][within].argmax()])
        yield statement(f"{name} peak of FDP", f"around {near:g}", at, "s", abs(at - near) <= 0.01, AROUND)
    before = (times > downswing) & (times < first)
    at = float(times[before][total["EC"][before].argmax()])
    why = "between AMMR's samples, 10 ms apart, the acceleration is a straight line, so its peaks are at samples"
    yield row_within("first peak, by inertia, of EC", "0.025", "0.030", at, "s", why)
    small, why = float(total["LU"].max() / total["FDP"].max()), "of LU, 'very small' is taken as below 0.05"
    yield statement("peak of LU over peak of FDP", "very small", small, "1", small < 0.05, why)


def _passive_rows(result: MovementResult) -> Iterator[Row]:
    at_peak = {p["muscle"]: 100.0 * p["passive_share"] for p in result.peaks()}
    most = dict(zip(result.muscles, 100.0 * result.passive_N.max(axis=0) / result.force.max(axis=0), strict=True))
    for m, printed in (("UI", "18"), ("RI", "10")):
        yield row(f"passive force of {m} at its peak", printed, at_peak[m], "%", READINGS)
        yield row(f"greatest passive force of {m} over its peak", printed, most[m], "%", READINGS)
    why = "negligible in the whole movement, says the paper"
    for m in ("FDP", "FDS", "EC", "EI", "LU"):
        yield row_within(f"greatest passive force of {m} over its peak", "0", "5", most[m], "%", why)
    greatest = result.passive_N.max(axis=0)
    two = {result.muscles[i] for i in np.argsort(greatest)[-2:]}
    least = float(min(greatest[result.muscles.index(m)] for m in ("UI", "RI")))
    why = "of the two greatest passive forces the lesser is shown"
    yield Row("greatest passive forces", None, least, "N", two == {"UI", "RI"}, why, "in UI and RI")


def _settings(result: MovementResult) -> Sheet:
    """Tabulate the influence of the open choices on the peaks."""
    runs: list[tuple[str, MovementResult]] = [
        ("as the paper says", result),
        ("without gravity", tap("wu2008", gravity=False)),
        ("angles as fourth-order polynomials", tap("wu2008", curve=("polynomial", 4))),
        ("AMMR's muscles", tap("wu2008_ammr")),
        ("AMMR's muscles, without gravity", tap("wu2008_ammr", gravity=False)),
    ]
    lines: list[Line] = []
    for name, run in runs:
        peaks = {p["muscle"]: p for p in run.peaks()}
        shares = [100.0 * peaks[m]["passive_share"] for m in ("UI", "RI")]
        lines.append((name, *(peaks[m]["peak_N"] for m in AMMR), *shares))
    output = ammr_output()
    lines.append(("AMMR's output", *(float(output[f"{a}_Ft_N"].max()) for a in AMMR.values()), None, None))
    lines.append(("paper", 3.80, 1.24, None, None, None, None, None, 18.0, 10.0))
    return Sheet(
        "Peak forces [N] and passive shares at the peak under other settings",
        ("setting", *AMMR, "passive UI [%]", "passive RI [%]"),
        lines,
        (
            "From -0.06 to 0.24 s; AMMR's output begins at 0.",
            "No setting gives the paper's FP of 3.80 N: at the DIP joint the tip force asks for 9 N mm, which FDP "
            "carries with 2.3 N at its moment arm of 4 mm.",
            "AMMR's muscles have passive force in the first of two heads alone: half of it in EC, EI, RI and UI.",
        ),
    )


def _directions() -> Sheet:
    """Tabulate the influence of the tip force's direction, which the paper does not print."""
    lines: list[Line] = []
    joints = ("MCP", "PIP", "DIP")
    for angle in (-15.0, 0.0, 15.0, 30.0, 45.0):
        run = tap("wu2008", turned_deg=angle)
        peak = {p["muscle"]: p for p in run.peaks()}
        torque = np.abs(run.torque_Nmm).max(axis=0)
        torques = (float(torque[run.rotations.index(name)]) for name in joints)
        ratios = (peak[m]["over_tip_force"] for m in ("FDS", "FDP"))
        lines.append((angle, *(peak[m]["peak_N"] for m in ("FDS", "FDP")), *ratios, *torques))
    lines.append((None, 1.24, 3.80, 0.95, 2.9, None, None, None))
    return Sheet(
        "Peaks when tip force and gravity are turned from dorsal towards distal",
        ("turned by [deg]", *("FDS [N]", "FDP [N]", "FDS over tip", "FDP over tip"), *(f"{j} [N mm]" for j in joints)),
        lines,
        (
            "Last line: the paper. Turned by 15 deg the metacarpal rises towards the finger, as over a keyboard.",
            "FDP is the paper's between 0 and 15 deg, FDS at 45: no direction gives both.",
        ),
    )


def _beside_ammr(later: MovementResult) -> Sheet:
    """Tabulate lengths and forces beside AMMR's output, with AMMR's muscles and at its times."""
    output = ammr_output()
    lines: list[Line] = []
    for i, (ours, theirs) in enumerate(AMMR.items()):
        length = 1e3 * _their_length(output, theirs)
        mine = later.length_mm[:, i]
        moved = (mine - mine[0]) - (length - length[0])
        force, their_force = later.force[:, i], output[f"{theirs}_Ft_N"]
        peaks, alike = (float(their_force.max()), float(force.max())), float(np.corrcoef(force, their_force)[0, 1])
        lines.append((ours, float(np.ptp(length)), _rms(moved), *peaks, _rms(force - their_force), alike))
    return Sheet(
        "Beside AMMR's output (40 instants from 0 to 0.24 s), with AMMR's muscles",
        (
            "muscle",
            "travel there [mm]",
            "RMS difference [mm]",
            "peak there [N]",
            "peak here [N]",
            "RMS difference [N]",
            "r",
        ),
        lines,
        (
            "Lengths are those of muscle and tendon less the first; of LU the mean weighted by the heads' strength, of "
            "RI the head that ends at the proximal phalanx: the other's path there runs to the PIP joint and back to "
            "the metacarpal, most likely a slip.",
            "Forces differ because AMMR recruits twelve heads by their strength at each length and speed, wraps "
            "tendons on ellipsoids, has a looser FS tendon (Epsilon0 is its fibre length, a slip) and another curve "
            "through the tip force, which matters where that force changes within a step, from 0.04 to 0.06 s.",
        ),
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _their_length(output: dict[str, Floats], name: str) -> Floats:
    """Return the length of a muscle in AMMR's output [m]: the mean of its heads, weighted as in our hood."""
    mean = output[f"{name}_lmt_m"]
    weight: dict[str, Any] = {"LU": 1.0 / 6.0, "RI": 0.5}
    return mean + weight[name] * output[f"{name}_err_m"] if name in weight else mean
