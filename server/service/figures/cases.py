"""Which load cases each point of a figure stands for, so that a click on it can lead to them."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fingermodel.comparison.comparison import muscles_of
from server.figures.style import plain, posture_name

# A label begins with the id of its case, in bold.
_FIRST = re.compile(r"\s*<b>(.*?)</b>")
Points = str | list[Any] | None


@dataclass(frozen=True)
class Told:
    """What a figure's labels may name of a load case.

    Attributes:
        id: of the case.
        role: of it.
        location: of the cell.
        muscles: that are loaded, such as `FDP+FDS`.
        posture: its name.
    """

    id: str
    role: str
    location: str
    muscles: str
    posture: str


def told_of(documents: Sequence[Mapping[str, Any]]) -> list[Told]:
    """Return what labels may name of the cases of a session's document."""
    return [
        Told(str(c["id"]), str(c.get("role")), str(c.get("location")), muscles_of(c.get("masses_g") or {}),
             str(c.get("posture")))
        for c in documents
    ]  # fmt: skip


def cases_of(figure: Mapping[str, Any], known: Sequence[Told]) -> list[Points]:
    """Return, trace by trace, the cases of its points.

    Args:
        figure: its plain data.
        known: cases that may be named.

    Returns:
        of each trace the id of the one case that all of it stands for, or a list with an id, a list of ids or null for
        each point (of a map for each row a list of those), or null where it stands for none.
    """
    names = {plain(c.id): c.id for c in known}
    ids = set(names.values())
    before: dict[tuple[Any, Any], list[Any]] = {}
    out: list[Points] = []
    for trace in figure["data"]:
        axes = trace.get("xaxis", "x"), trace.get("yaxis", "y")
        meta = trace.get("meta") if isinstance(trace.get("meta"), dict) else {}
        found: Points
        if meta.get("case"):
            found = str(meta["case"]) if str(meta["case"]) in ids else None
        elif isinstance(meta.get("cases"), list):
            found = [c if c in ids else None for c in meta["cases"]]
        elif meta.get("kind") == "missing":
            found = before.get(axes)
        elif trace.get("type") == "heatmap":
            found = _of_map(trace, figure["layout"], known)
        else:
            found = _of_labels(trace, figure["layout"], names, known)
        if isinstance(found, list):
            before[axes] = found
        out.append(found)
    return out


def _of_labels(
    trace: Mapping[str, Any], layout: Mapping[str, Any], names: Mapping[str, str], known: Sequence[Told]
) -> Points:
    labels = next((trace[k] for k in ("hovertext", "text") if isinstance(trace.get(k), list)), None)
    if labels is None:
        return None
    found: list[Any] = [names.get(m[1]) if (m := _FIRST.match(str(label))) else None for label in labels]
    if not any(found):
        found = [_of_group(str(label), trace, layout, known) for label in labels]
    return found if any(found) else None


def _of_group(
    label: str, trace: Mapping[str, Any], layout: Mapping[str, Any], known: Sequence[Told]
) -> list[str] | None:
    """Cases that a bar stands for: of a tendon, a posture, a role and place, or of a posture with a tendon."""
    text = html.unescape(label)
    torque = re.match(r"<b>\w+</b> (.+?), (.+?)<br>", text)
    if torque is not None:
        found = [
            c.id for c in known
            if c.muscles == torque[1] and posture_name(c.posture) == plain(torque[2]) and c.role == "identification"
            and c.location == "tip"
        ]  # fmt: skip
        return found or None
    name = text.partition(": ")[0]
    heading = _heading(trace, layout)
    place = next((p for p in ("tip", "bone") if heading.lower().startswith(f"{p}, ")), None)
    if place is None:
        return [c.id for c in known if f"{c.role}, {c.location}" == name] or None
    by_posture = "posture" in heading
    return [
        c.id for c in known if c.location == place and (posture_name(c.posture) if by_posture else c.muscles) == name
    ] or None


def _heading(trace: Mapping[str, Any], layout: Mapping[str, Any]) -> str:
    """Heading of the group of bars that a trace is in: the lowest one that stands at or above its panel's top."""
    axis = layout.get(str(trace.get("yaxis", "y")).replace("y", "yaxis", 1)) or {}
    top = (axis.get("domain") or [0.0, 1.0])[1]
    above = [a for a in layout.get("annotations") or () if a.get("yref") == "paper" and a.get("y", 0.0) >= top - 1e-9]
    nearest: Mapping[str, Any] = min(above, key=lambda a: a["y"], default={})
    return re.sub(r"<[^>]*>", "", str(nearest.get("text", "")))


def _of_map(trace: Mapping[str, Any], layout: Mapping[str, Any], known: Sequence[Told]) -> Points:
    """Cases of the cells of a map by tendons and posture, a panel for each mount; other maps have none."""
    labels = trace.get("hovertext")
    if not isinstance(labels, list) or not any(_cell(str(t)) for line in labels for t in line):
        return None
    return [[_of_cell(str(text), known) for text in line] for line in labels]


def _cell(text: str) -> re.Match[str] | None:
    return re.match(r"<b>(.+?)</b> (.+), ([^,]+): \d+ cases?<br>", text)


def _of_cell(text: str, known: Sequence[Told]) -> list[str] | None:
    found = _cell(text)
    if found is None:
        return None
    return [
        c.id
        for c in known
        if plain(c.muscles) == found[1] and posture_name(c.posture) == found[2] and plain(c.location) == found[3]
        and c.role == "identification"
    ] or None  # fmt: skip
