"""Sensitivity analysis: the probability of what the verdict says under each assumption, and without some data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import BETTER, WORSE, Answer, probability_text, rows, shortened, value
from server.figures.sheet import Sheet, note, shape
from server.figures.style import INK, MUTED, SMALL_PX, NothingToDrawError, axis, named_axis, plain

# From this probability on a verdict is sure.
SURE = 0.9
MOST_ROWS = 40
_ROW, _MARGINS = 21, (70, 108, 52)  # [px]; margins at the right, above and below
_LONGEST = 62  # of a label [characters]
_GROUPS = {
    "prior": "Prior probability of nothing",
    "width": "Size that effects may have",
    "budget": "Budget of the rig",
    "anatomy": "Anatomy of the specimen",
    "noise": "Noise of the readings",
    "without": "Parts of the data left out",
    "plane": "Force components that count",
}
_KINDS = (("sure", BETTER, "circle"), ("not sure", "#7f7f7f", "circle-open"), ("below one half", WORSE, "diamond"))


class Assumed(NamedTuple):
    """One assumption: its group, its words, and the probability of what the verdict says under it."""

    group: str
    words: str
    probability: float


def assumptions(answer: Answer) -> list[Assumed]:
    """Return the assumptions that were tried, in the order of their groups."""
    out = []
    for row in rows(answer, "robustness", "assumptions"):
        p = value(row.get("probability"))
        if p is not None and row.get("words"):
            out.append(
                Assumed(str(row.get("group") or ""), str(row.get("words")).replace("_", " "), min(max(p, 0.0), 1.0))
            )
    order = list(dict.fromkeys([*_GROUPS, *(a.group for a in out)]))
    return sorted(out, key=lambda a: order.index(a.group))


def sensitivity_figure(answer: Answer) -> go.Figure:
    """Draw a dot for each assumption, grouped, with a line where a verdict begins to be sure.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: no assumption was varied.
    """
    found = assumptions(answer)
    if not found:
        raise NothingToDrawError("There is no sensitivity analysis: no assumption was varied.")
    total, shown = len(found), _shown(found)
    places, headings, at = [], [], 0.0
    for i, one in enumerate(shown):
        if not i or one.group != shown[i - 1].group:
            headings.append((at, _GROUPS.get(one.group, one.group)))
            at += 1.0
        places.append(at)
        at += 1.0
    labels = [shortened(a.words, _LONGEST) for a in shown]
    left = 40 + round(6.4 * max(len(t) for t in [*labels, *(h for _, h in headings)]))
    sheet = Sheet(round(_ROW * at), (left, *_MARGINS), showlegend=True)
    sheet.panel(
        axis("probability of what the verdict says", range=[-0.02, 1.03], tickvals=[0, 0.25, 0.5, 0.75, 1.0]),
        named_axis(places, map(plain, labels), (at - 0.4, -0.6), showline=False),
    )
    sheet.data += _dots(shown, places)
    sheet.notes += [_word(f"<b>{plain(text)}</b>", 0.0, y, "right", -8, INK) for y, text in headings]
    sheet.notes += [
        _word(plain(probability_text(a.probability)), 1.0, y, "left", 12, MUTED)
        for y, a in zip(places, shown, strict=True)
    ]
    sheet.shapes.append(_line(SURE, INK, "dash"))
    said = "Dashed: 0.9, from which a verdict is sure."
    if (stated := value(answer.get("probability"))) is not None:
        sheet.shapes.append(_line(min(max(stated, 0.0), 1.0), "#b5b5b5", "solid"))
        said += f" Grey line: as stated, {plain(probability_text(stated))}."
    if total > len(shown):
        said += f" {total - len(shown)} parts whose absence changes least are not drawn."
    return sheet.drawn("Sensitivity analysis", said, legend_px=10)


def _shown(found: Sequence[Assumed]) -> list[Assumed]:
    """Return all assumptions, or of the parts that are left out those that matter most."""
    parts = sorted((a for a in found if a.group == "without"), key=lambda a: a.probability)
    kept = parts[: max(MOST_ROWS - (len(found) - len(parts)), 0)]
    return [a for a in found if a.group != "without" or a in kept][:MOST_ROWS]


def _kind(probability: float) -> int:
    return 0 if probability >= SURE else 1 if probability >= 0.5 else 2


def _dots(shown: Sequence[Assumed], places: Sequence[float]) -> list[go.Scatter]:
    out = []
    for k, (name, color, symbol) in enumerate(_KINDS):
        own = [(a, y) for a, y in zip(shown, places, strict=True) if _kind(a.probability) == k]
        if own:
            look = {"symbol": symbol, "size": 10, "color": color}
            words = [f"{plain(a.words)}: {plain(probability_text(a.probability))}" for a, _ in own]
            x, y = zip(*((a.probability, at) for a, at in own), strict=True)
            out.append(marks.points(x, y, look, words, name=name, cliponaxis=False))
    return out


def _line(x: float, color: str, dash: str) -> dict[str, Any]:
    return shape((x, x), (0.0, 1.0), ("x", "paper"), line={"color": color, "width": 1.5, "dash": dash})


def _word(text: str, x: float, y: float, side: str, shift: int, ink: str) -> dict[str, Any]:
    return note(text, x, y, ("paper", "y"), at=(side, "middle"), shift=(shift, 0), size=SMALL_PX, color=ink)


def verdict_under(answer: Answer) -> tuple[int, int]:
    """Return how many assumptions keep the verdict sure, of how many; parts that are left out are not counted."""
    tried = [a for a in assumptions(answer) if a.group != "without"]
    return sum(a.probability >= SURE for a in tried), len(tried)
