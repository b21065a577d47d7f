"""The joint torque that the readings ask for and the model does not give, by joint, posture and loaded tendon."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import (
    Answer,
    after_which_fit,
    in_tendon_order,
    muscles_of,
    part,
    rows,
    shortened,
    value,
)
from server.figures.sheet import Sheet, note
from server.figures.style import (
    INK,
    MUTED,
    SMALL_PX,
    ZERO_LINE,
    NothingToDrawError,
    axis,
    named_axis,
    number,
    plain,
    posture_name,
    whiskers,
)

CLEAR, WITHIN = "#D55E00", "#9fb4c7"
MOST_ROWS = 40
_LONGEST = 30  # of a label [characters]
_ROW, _BETWEEN, _MARGINS = 18, 26, (20, 112, 62)  # [px]; margins at the right, above and below
_JOINTS = ("MCP", "PIP", "DIP")
_FITTED = {"role": "identification", "location": "tip"}


class Torque(NamedTuple):
    """Missing torque of one joint [N mm] with its standard deviation, where that is known."""

    value: float
    sd: float | None

    @property
    def clear(self) -> bool:
        """True if it is more than two standard deviations from nothing."""
        return self.sd is not None and abs(self.value) > 2.0 * self.sd


class Group(NamedTuple):
    """The cases of one posture and tendon: their mean torque by joint."""

    posture: str
    label: str
    cases: int
    torques: dict[str, Torque]


def torque_figure(answer: Answer) -> go.Figure:
    """Draw the missing torque of every joint with error bars, a row for every posture and loaded tendon.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: no torque.
    """
    groups = _by_case(answer) or _by_joint(answer)
    total = len(groups)
    if not total:
        raise NothingToDrawError("No missing joint torque could be worked out.")
    groups = _largest(groups, MOST_ROWS)
    found = list(dict.fromkeys(j for g in groups for j in g.torques))
    joints = [j for j in _JOINTS if j in found] + [j for j in found if j not in _JOINTS]
    places, headings, count = _places(groups)
    ends = [abs(t.value) + (t.sd or 0.0) for g in groups for t in g.torques.values()]
    reach = 1.12 * max(ends, default=0.0) or 1.0
    left = 40 + 7 * max([len(shortened(g.label, _LONGEST)) for g in groups] + [len(h) + 2 for h, _ in headings])
    sheet = Sheet(_ROW * count, (left, *_MARGINS), barmode="overlay", showlegend=True)
    labels = [plain(shortened(g.label, _LONGEST)) for g in groups]
    named: set[str] = set()
    for index, joint in enumerate(joints):
        axes = sheet.panel(
            axis("missing torque [N mm]", range=[-reach, reach], nticks=6, **ZERO_LINE),
            named_axis(places, labels, (count - 0.4, -0.6), showticklabels=index == 0, showgrid=False, showline=False),
            **sheet.grid(0, index, len(joints), sheet.high, (_BETWEEN, 0)),
            heading=plain(shortened(joint, 16)),
            above=0,
        )
        sheet.data += _bars(groups, places, joint, axes, named)
    for text, place in headings:
        look: dict[str, Any] = {"at": ("right", "middle"), "shift": (-8, 0), "size": SMALL_PX + 1, "color": MUTED}
        sheet.notes.append(note(f"<b>{text}</b>", 0.0, place, ("paper", "y"), **look))
    return sheet.drawn(
        f"Joint torque that is missing, {plain(after_which_fit(answer))}",
        _subtitle(groups, total),
        legend_px=20,
        at_right=True,
    )


def _by_case(answer: Answer) -> list[Group]:
    """Return groups of cases alike in posture and load, with their mean torques."""
    own: dict[tuple[str, str], list[Answer]] = {}
    for row in rows(answer, "where", "joint_torque_cases"):
        own.setdefault((str(row.get("posture", "")), muscles_of(row)), []).append(row)
    postures = list(dict.fromkeys(p for p, _ in own))
    muscles = in_tendon_order(m for _, m in own)
    out = []
    for posture, muscle in sorted(own, key=lambda k: (postures.index(k[0]), muscles.index(k[1]))):
        cases = own[posture, muscle]
        torques = {j: _mean(cases, j) for j in dict.fromkeys(str(j) for c in cases for j in part(c, "torque_Nmm"))}
        known = {j: t for j, t in torques.items() if t is not None}
        if known:
            out.append(Group(posture, muscle, len(cases), known))
    return out


def _mean(cases: Sequence[Answer], joint: str) -> Torque | None:
    pairs = [(value(part(c, "torque_Nmm").get(joint)), value(part(c, "sd_Nmm").get(joint))) for c in cases]
    values = [v for v, _ in pairs if v is not None]
    spreads = [s for v, s in pairs if v is not None and s is not None]
    if not values:
        return None
    sd = math.sqrt(sum(s**2 for s in spreads)) / len(values) if len(spreads) == len(values) else None
    return Torque(sum(values) / len(values), sd)


def _by_joint(answer: Answer) -> list[Group]:
    """Return one group of all cases, where only their root mean square is known."""
    found = {str(j): part(v) for j, v in part(answer, "where", "joint_torque_Nmm").items()}
    torques = {j: Torque(r, value(v.get("sd"))) for j, v in found.items() if (r := value(v.get("rms"))) is not None}
    return [Group("", "all cases, root mean square", 0, torques)] if torques else []


def _largest(groups: list[Group], most: int) -> list[Group]:
    if len(groups) <= most:
        return groups
    order = sorted(groups, key=lambda g: -max(abs(t.value) / (t.sd or 1.0) for t in g.torques.values()))
    return [g for g in groups if g in order[:most]]


def _places(groups: Sequence[Group]) -> tuple[list[float], list[tuple[str, float]], float]:
    """Return the row of each group, rows of the postures' names, and their number."""
    places: list[float] = []
    headings: list[tuple[str, float]] = []
    row, posture = 0.0, ""
    for group in groups:
        if group.posture != posture:
            posture = group.posture
            row += 0.35 if places else 0.0
            headings.append((posture_name(shortened(posture, _LONGEST)), row))
            row += 1.0
        places.append(row)
        row += 1.0
    return places, headings, row


def _bars(
    groups: Sequence[Group], places: Sequence[float], joint: str, axes: dict[str, str], named: set[str]
) -> list[go.Bar]:
    """Return the bars of one joint, coloured where clear of zero; `named` are the legend's words so far."""
    out = []
    for clear, color, name in ((True, CLEAR, "beyond two standard deviations"), (False, WITHIN, "within them")):
        chosen = [(g, p) for g, p in zip(groups, places, strict=True) if joint in g.torques]
        chosen = [(g, p) for g, p in chosen if g.torques[joint].clear == clear]
        if not chosen:
            continue
        torques = [g.torques[joint] for g, _ in chosen]
        out.append(
            marks.bars(
                [t.value for t in torques],
                [p for _, p in chosen],
                color,
                [_hover(g, joint) for g, _ in chosen],
                orientation="h",
                width=0.72,
                error_x=whiskers([t.sd or 0.0 for t in torques], INK, width=2),
                name=name,
                legendgroup=name,
                showlegend=name not in named,
                meta={"select": [_FITTED | {"posture": g.posture, "muscles": g.label} for g, _ in chosen]},
                **axes,
            )
        )
        named.add(name)
    return out


def _hover(group: Group, joint: str) -> str:
    torque = group.torques[joint]
    where = f", {posture_name(group.posture)}" if group.posture else ""
    many = f"<br>mean of {group.cases} cases" if group.cases > 1 else ""
    sd = f" ± {number(torque.sd)}" if torque.sd is not None else ""
    return f"<b>{plain(joint)}</b> {plain(group.label)}{where}<br>{number(torque.value)}{sd} N mm{many}"


def _subtitle(groups: Sequence[Group], total: int) -> str:
    left = f"; the {len(groups)} clearest of {total} groups" if total > len(groups) else ""
    return f"Residual forces taken back through the Jacobian; bars with one standard deviation{left}."
