"""Look at what the windows hold: load changes inside them, creep, drift between tares, wrong signs and sizes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.cells import CellSpec, at_limit
from daq.checks.description import beyond_weights, case_name
from daq.findings import Finding, finding
from daq.measured import MeasuredSession
from daq.recordings.plateaus import TOLERANCE, Plateau
from daq.recordings.readings import HEADERS
from daq.recordings.windows import Span
from daq.sessions.models import Session
from daq.signals.tension_estimate import PUBLISHED_TENSION_FACTOR

Floats = NDArray[np.float64]

AXES = HEADERS[1:]
# The best of hundreds of moments in hundreds of windows on six axes: chance does not reach this many deviations.
SHIFT_DEVIATIONS = 7.0
# No noise, whatever its tails, puts one reading so far from all others.
WILD_DEVIATIONS = 20.0
# A change of level that a case bears: half of what counts as steady.
LEAST_SHIFT = 0.5 * TOLERANCE
# Share of the force by which readings may creep as a rule: about what a pulley's friction is uncertain by.
_CREEP = 0.01
# What is left of no scatter when a mean is taken off.
_NO_SD = 1e-9
# Means of the published specimens differ from their mean by 0.08 at most.
UNUSUAL_FACTOR = 0.1
TARE_CHANGE = np.array([0.25, 0.25, 0.25, 5.0, 5.0, 5.0])


def saturated(plateau: Plateau, spec: CellSpec | None) -> bool:
    """Say whether a window holds a reading at or beyond the cell's full scale."""
    return spec is not None and bool(at_limit(plateau.peak, np.array(spec.range)).any())


def plateau_findings(session: Session, plateaus: Mapping[Span, Plateau], spec: CellSpec | None) -> list[Finding]:
    """Find windows with saturated, flagged or frozen readings, a change of load or creep inside."""
    users: dict[Span, list[str]] = defaultdict(list)
    for case in session.cases:
        if case.excluded is None:
            for name, window in case.windows():
                users[window].append(f"{case_name(case)}: {name}")
    for i, check in enumerate(session.checks):
        users[check.unloaded_s].append(f"checks[{i}]: unloaded_s")
        users[check.loaded_s].append(f"checks[{i}]: loaded_s")
    spans = [w for w in users if w in plateaus]
    if not spans:
        return []
    out = []
    noise = _noise_per_reading([plateaus[w] for w in spans])
    # Of a channel whose noise exceeds its step in most windows, no window is without any by chance.
    step = np.max([plateaus[w].step for w in spans], axis=0)
    alive = (np.median([plateaus[w].sd for w in spans], axis=0) >= step) & (step > 0.0)
    open_ended = 0
    for window in spans:
        plateau, where = plateaus[window], _named(users[window])
        found = _wild_reading(plateau, where) or _load_change(plateau, noise, where)
        if spec is not None and saturated(plateau, spec):
            out.append(_at_limit(plateau, spec, where))
        elif (still := alive & (plateau.step == 0.0) & (plateau.sd < _NO_SD)).any():
            out.append(_standing_still(plateau, still, where))
        elif found is not None:
            out.append(found)
        elif plateau.flagged:
            out.append(
                finding(
                    "warning", "flagged_window", where, f"{plateau.flagged} readings carry status flags", "status 0"
                )
            )
        elif plateau.steady is False:
            creep = plateau.slope_per_s * _length(plateau)
            k = int(np.argmax(np.maximum(np.abs(creep), np.abs(plateau.halves)) / TOLERANCE))
            out.append(
                finding(
                    "warning",
                    "not_steady",
                    where,
                    f"{AXES[k]} creeps by {creep[k]:.3g} over {_length(plateau):.3g} s",
                    f"at most {TOLERANCE[k]:g}",
                    "Wait longer after loading, or move the window",
                )
            )
        open_ended += plateau.steady is None
    if open_ended:
        out.append(
            finding(
                "note",
                "steadiness_open",
                "cases",
                f"{open_ended} of {len(spans)} windows are too short or noisy to rule out a change of "
                f"{TOLERANCE[0]:g} N or {TOLERANCE[3]:g} N mm",
            )
        )
    return out


def creep_findings(measured: MeasuredSession) -> list[Finding]:
    """Say that loaded readings creep as a rule, and that the model counts with it."""
    if not measured.creep:
        return []
    return [
        finding(
            "warning" if abs(measured.creep) > _CREEP else "note",
            "creep",
            "cases",
            f"loaded readings change by {100.0 * measured.creep:.1f} % of their force within their windows",
            "readings that have settled",
            "Wait longer after loading. That they have about as far to go counts as an error of all tensions alike",
        )
    ]


def tare_findings(measured: MeasuredSession) -> tuple[list[Finding], dict[str, Any]]:
    """Compare the tares that were taken in one posture, setting and mounting.

    Returns:
        findings, and the largest change by axis with the number of pairs compared.
    """
    groups: dict[tuple[Any, ...], set[int]] = defaultdict(set)
    for m, weights in zip(measured.cases, measured.tare_weights, strict=True):
        case = m.case
        key = (case.location, case.mounting, case.posture, case.setting, case.unloaded_state)
        groups[key] |= {int(k) for k in np.flatnonzero(weights)}
    largest, pairs, place = np.zeros(6), 0, ""
    for key, members in groups.items():
        ordered = sorted(members, key=lambda k: measured.tares[k].mid_s)
        for a, b in pairwise(ordered):
            pairs += 1
            change = np.abs(measured.tares[b].mean - measured.tares[a].mean)
            if (change / TARE_CHANGE).max() > (largest / TARE_CHANGE).max():
                place = f"{key[2]} at {key[0]}, {measured.tares[a].mid_s:.4g} to {measured.tares[b].mid_s:.4g} s"
            largest = np.maximum(largest, change)
    facts = {
        "tares": len(measured.tares),
        "tare_pairs": pairs,
        "largest_tare_change_N_Nmm": largest.tolist() if pairs else None,
    }
    if not pairs:
        return [], facts
    k = int(np.argmax(largest / TARE_CHANGE))
    text = f"the zero changed by up to {largest[k]:.3g} {'N' if k < 3 else 'N mm'} ({AXES[k]}; {place})"
    if (largest > TARE_CHANGE).any():
        remedy = "Bracket each case with unloaded_after_s, let the cell warm up, and look at the mounting"
        return [
            finding("warning", "tare_drift", "tares", text, f"at most {TARE_CHANGE[k]:g} between two tares", remedy)
        ], facts
    return [finding("note", "tare_drift", "tares", text)], facts


def sign_findings(measured: MeasuredSession) -> list[Finding]:
    """Look whether FDP pulls the tip distally and palmarly, and the flexors load the bone proximally."""
    session = measured.session
    tip: dict[str, list[float]] = {"x": [], "y": []}
    bone: list[float] = []
    for m in measured.cases:
        posture = session.postures_deg[m.case.posture]
        loaded = {t for t, g in m.case.masses_g.items() if g > 0.0}
        force = m.wrench[:3]
        weight = sum(m.case.masses_g.values()) * 1e-3 * session.gravity_m_s2
        if m.case.location == "tip" and loaded == {"FDP"} and posture.PIP > 20.0 and posture.DIP > 10.0:
            tip["y"].append(float(force[1]) / weight)
            # Of a finger that is less flexed, FDP pushes the tip proximally as well as distally.
            if posture.PIP >= 60.0 and posture.DIP >= 45.0:
                tip["x"].append(float(force[0]) / weight)
        if m.case.location == "bone" and loaded and loaded <= {"FDP", "FDS"}:
            bone.append(float(force[0]) / weight)
    out = [
        finding(
            "warning",
            "wrong_sign",
            "load_cell.mounts.tip",
            f"FDP alone pushes the tip towards {name} ({np.mean(tip[axis]):+.2f} of its weight in {axis})",
            f"{other}: negative {axis}",
            "Are readings the force on the finger instead of the cell, or the axes exchanged?",
        )
        for axis, name, other in (("x", "proximal", "distal"), ("y", "dorsal", "palmar"))
        if tip[axis] and np.mean(tip[axis]) > 0.03
    ]
    if bone and np.mean(bone) < 0.0:
        out.append(
            finding(
                "warning",
                "wrong_sign",
                "load_cell.mounts.bone",
                f"the flexors push the bone distally ({np.mean(bone):+.2f} of their weight in x)",
                "proximally: positive x",
                "Are readings the force on the finger instead of the cell, or the axes exchanged?",
            )
        )
    return out


def force_findings(measured: MeasuredSession) -> Iterator[Finding]:
    """Find recorded forces far above the weights that cause them."""
    for m in measured.cases:
        weight = sum(m.case.masses_g.values()) * 1e-3 * measured.session.gravity_m_s2
        force = float(np.linalg.norm(m.wrench[:3]))
        if m.plateau is not None and beyond_weights(force, weight):
            yield finding(
                "warning",
                "force_units",
                case_name(m.case),
                f"{force:.3g} N for {weight:.3g} N of weights",
                "a force of about the weights or less",
                "Look at the window, the masses and the units",
            )


def tension_findings(measured: MeasuredSession) -> list[Finding]:
    """Say where the friction correction that was estimated is not friction's alone."""
    found = measured.estimated_tension
    if found is None:
        return []
    value = f"tension_factor {found.value:.3f} ± {found.sd:.3f}, estimated by force balance"
    beside = f"a force of {found.constant_N:.2g} ± {found.constant_sd_N:.1g} N comes beside the weights"
    remedy = "Weigh the hangers, look at tares, mounts and masses, or state tension_factor as a number"
    out = []
    if found.above_one:
        pairs = f"{found.above_one} of {found.pairs} pairs of tip and bone cases pull more than the weights; {beside}"
        out.append(
            finding("warning", "more_than_weights", "tension_factor", pairs, "less, as friction leaves it", remedy)
        )
    if abs(found.value - PUBLISHED_TENSION_FACTOR) > UNUSUAL_FACTOR:
        usual = f"{PUBLISHED_TENSION_FACTOR} ± {UNUSUAL_FACTOR:g}, as on published specimens"
        out.append(finding("warning", "unusual_tension_factor", "tension_factor", value, usual, remedy))
    return out


def _named(users: Sequence[str]) -> str:
    return users[0] if len(users) == 1 else f"{users[0]} (and {len(users) - 1} more)"


def _length(plateau: Plateau) -> float:
    return plateau.end_s - plateau.start_s


def _noise_per_reading(plateaus: Sequence[Plateau]) -> Floats:
    """Return (6,) variance of a mean times the readings in it, as in the quieter windows, which hold no load change."""
    return np.quantile([np.diag(p.covariance) * p.readings for p in plateaus], 0.3, axis=0)


def _at_limit(plateau: Plateau, spec: CellSpec, where: str) -> Finding:
    k = int(np.argmax(plateau.peak / np.array(spec.range)))
    return finding(
        "error",
        "saturated_window",
        where,
        f"{AXES[k]} reaches {plateau.peak[k]:g}, and the cell's full scale is {spec.range[k]:g}",
        "readings inside the cell's range",
        "Exclude the case, or remove the known weight",
    )


def _standing_still(plateau: Plateau, still: NDArray[np.bool_], where: str) -> Finding:
    k = int(np.flatnonzero(still)[0])
    return finding(
        "warning",
        "still_window",
        where,
        f"all {plateau.readings} readings of {AXES[k]} are {plateau.mean[k]:g}",
        "noise, as in the other windows",
        "Was a channel at its limit, or a wire broken? Exclude the case",
    )


def _wild_reading(plateau: Plateau, where: str) -> Finding | None:
    """Tell one reading that is far from all others, such as of a flipped bit, from a change of level beside it."""
    found = np.abs(plateau.wild) > np.maximum(WILD_DEVIATIONS * plateau.others_sd, TOLERANCE)
    if not found.any():
        return None
    k = int(np.argmax(np.where(found, np.abs(plateau.wild) / TOLERANCE, 0.0)))
    unit = "N" if k < 3 else "N mm"
    return finding(
        "warning",
        "wild_reading",
        where,
        f"{AXES[k]} at {plateau.wild_s[k]:.6g} s is {plateau.wild[k]:+.3g} {unit} off the other {plateau.readings - 1} "
        f"readings, and moves their mean by {plateau.wild[k] / plateau.readings:+.2g} {unit}",
        f"readings within {WILD_DEVIATIONS:g} standard deviations ({plateau.others_sd[k]:.2g} {unit})",
        "A flipped bit, or a knock? Move the window so that it lies outside",
    )


def _load_change(plateau: Plateau, noise: Floats, where: str) -> Finding | None:
    """Tell a sudden change of level from noise, and from creep, which a line describes better."""
    deviations = np.sqrt(plateau.shift_gain / noise)
    sudden = plateau.shift_gain > plateau.line_gain
    found = (deviations > SHIFT_DEVIATIONS) & (np.abs(plateau.shift) > LEAST_SHIFT) & sudden
    if not found.any():
        return None
    k = int(np.argmax(np.where(found, np.abs(plateau.shift) / TOLERANCE, 0.0)))
    unit = "N" if k < 3 else "N mm"
    return finding(
        "error" if abs(plateau.shift[k]) > TOLERANCE[k] else "warning",
        "load_change",
        where,
        f"{AXES[k]} changes by {plateau.shift[k]:+.3g} {unit} inside [{plateau.start_s:g}, {plateau.end_s:g}] s",
        "a window that ends before the load changes and begins after it has settled",
        "Move the window",
    )
