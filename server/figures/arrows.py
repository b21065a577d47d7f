"""Force vectors and the areas of their measurement, in the plane [N], drawn at a point of the finger [mm]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, Comparison
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.style import case_text, number, rgba

Floats = NDArray[np.float64]

BETWEEN = "measured mean ± 1 SD between specimens"
MEASURED = "measured ± 1 standard uncertainty"
NOMINAL = "measured ± 10 % and ± 10° (uncertainty not stated)"


@dataclass(frozen=True)
class Spread:
    """Standard deviation of one case's force between specimens, in the sagittal plane."""

    magnitude_N: float
    direction_deg: float


@dataclass(frozen=True)
class Area:
    """Half-widths of the area about a measured vector, and what they stand for."""

    magnitude_N: float
    direction_deg: float
    meaning: str


def spread_between(reference: Comparison, specimens: Sequence[Comparison]) -> dict[str, Spread]:
    """Return the spread between specimens of every case of their average that at least two of them have.

    Cases belong together by posture, location, role and loaded tendons, and among those by their order of load.

    Args:
        reference: of the averaged session.
        specimens: one comparison each; only the measured forces are used.
    """
    tables = [_numbered(s) for s in specimens]
    out = {}
    for key, case in _numbered(reference).items():
        forces = np.array([t[key].measured_N[:2] for t in tables if key in t])
        if len(forces) < 2:
            continue
        angles = np.arctan2(forces[:, 1], forces[:, 0])
        about = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())
        turned = np.rad2deg((angles - about + np.pi) % (2 * np.pi) - np.pi)
        norms = np.hypot(forces[:, 0], forces[:, 1])
        out[case.id] = Spread(float(norms.std(ddof=1)), float(turned.std(ddof=1)))
    return out


def _numbered(comparison: Comparison) -> dict[tuple[object, ...], CaseComparison]:
    seen: dict[tuple[object, ...], int] = {}
    out: dict[tuple[object, ...], CaseComparison] = {}
    for case in sorted(comparison.cases, key=lambda c: sum(c.masses_g.values())):
        key = (case.posture, case.location, case.role, case.muscles)
        seen[key] = seen.get(key, -1) + 1
        out[(*key, seen[key])] = case
    return out


def area_of(case: CaseComparison, noise_assumed: bool, spread: Mapping[str, Spread] | None) -> Area:
    """Choose the area about a measured vector: between specimens, else measured, else ± 10 % and ± 10°."""
    force = case.measured_N[:2]
    norm = float(np.hypot(*force))
    if spread and case.id in spread:
        return Area(spread[case.id].magnitude_N, spread[case.id].direction_deg, BETWEEN)
    sd = np.asarray(case.measured_sd_N[:2], dtype=float)
    if noise_assumed or norm == 0 or not np.all(np.isfinite(sd)) or not np.any(sd > 0):
        return Area(0.1 * norm, 10.0, NOMINAL)
    along, across = force / norm, np.array([-force[1], force[0]]) / norm
    return Area(float(np.hypot(*(along * sd))), float(np.rad2deg(np.arctan2(np.hypot(*(across * sd)), norm))), MEASURED)


def sector(force: Floats, area: Area, origin: Floats, mm_per_N: float) -> Floats:
    """Return the outline (n, 2) of magnitude ± its half-width and direction ± its half-width [mm]."""
    norm, direction = float(np.hypot(*force)), float(np.arctan2(force[1], force[0]))
    half = np.deg2rad(min(area.direction_deg, 180.0))
    angles = direction + np.linspace(-half, half, max(7, int(np.ceil(np.rad2deg(half) / 2.0)) * 2 + 1))
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    outer, inner = norm + area.magnitude_N, max(norm - area.magnitude_N, 0.0)
    ring = np.concatenate([outer * ray, inner * ray[::-1], outer * ray[:1]])
    return np.asarray(origin[:2] + mm_per_N * ring)


def sector_trace(
    case: CaseComparison,
    force: Floats,
    area: Area,
    origin: Floats,
    mm_per_N: float,
    color: str,
    axes: Mapping[str, str],
) -> go.Scatter:
    """Draw the area about a measured force (2,) [N], given in the first bone's axes."""
    half = f"± {number(area.magnitude_N)} N, ± {number(area.direction_deg, 1)}°: {area.meaning}"
    return marks.area(
        *marks.xy(sector(force, area, origin, mm_per_N)),
        rgba(color, 0.22),
        {"color": rgba(color, 0.35), "width": 0.8},
        hoveron="fills",
        hoverinfo="text",
        text=f"{case_text(case)}<br>measured {vector_text(force)}<br>{half}",
        meta={"kind": "area", "case": case.id, "meaning": area.meaning},
        **axes,
    )


def arrow_traces(
    force: Floats,
    origin: Floats,
    mm_per_N: float,
    axes: Mapping[str, str],
    *,
    kind: str,
    case: CaseComparison,
    line: Mapping[str, Any],
    head_mm: float,
    hollow: bool = False,
    words: str = "",
) -> list[go.Scatter]:
    """Draw a force (2,) [N] from a point: its shaft, and a head that never exceeds 45 % of it.

    Args:
        force: in the first bone's axes.
        origin: (2 or more,) [mm].
        mm_per_N: scale.
        axes: `xaxis` and `yaxis` of the panel.
        kind: measured, predicted, before_predicted or joint; stands with case and force in the trace's `meta`.
        case: whose force it is.
        line: Plotly's color, width and dash.
        head_mm: length of the head.
        hollow: leave the head unfilled.
        words: before magnitude and direction where it is pointed at; by default the kind.
    """
    norm = float(np.hypot(*force))
    start = np.asarray(origin[:2], dtype=float)
    tip = start + mm_per_N * force
    meta = {"kind": kind, "case": case.id, "force_N": [float(force[0]), float(force[1])], "mm_per_N": mm_per_N}
    along = force / norm if norm > 0 else np.zeros(2)
    neck, head = arrow_head(tip, along, min(head_mm, 0.45 * mm_per_N * norm))
    shaft = marks.xy(np.stack([start, neck]))
    traces = [marks.line(*shaft, dict(line), meta=meta, showlegend=False, **axes)]
    if norm > 0:
        color = line["color"]
        traces.append(
            marks.area(
                *marks.xy(head),
                "#ffffff" if hollow else color,
                {"color": color, "width": line["width"] if hollow else 1.0},
                hoveron="points+fills",
                hoverinfo="text",
                text=f"{case_text(case)}<br>{words or kind} {vector_text(force)}",
                meta={"kind": f"{kind}_head", "case": case.id},
                **axes,
            )
        )
    return traces


def arrow_head(tip: Floats, along: Floats, length: float) -> tuple[Floats, Floats]:
    """Return where an arrow's shaft ends (2,), and the outline (4, 2) of its head of that length along a direction."""
    side = np.array([-along[1], along[0]]) * 0.36 * length
    back = tip - along * length
    return tip - along * 0.9 * length, np.stack([tip, back + side, back - side, tip])


def vector_text(force: Floats) -> str:
    """Write magnitude and direction of a force (2,) [N]."""
    turn = float(np.rad2deg(np.arctan2(force[1], force[0])))
    return f"{number(float(np.hypot(*force)))} N at {number(turn, 1)}° (0° proximal, 90° dorsal)"
