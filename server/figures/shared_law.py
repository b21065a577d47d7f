"""Common ground of several sessions beyond the catalogue: a curve by tendon and joint, and its test against chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.findings import warning_line
from fingermodel.parameters import with_unit
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import Answer, masses_of, part, rows, shown, text, value, vector, words
from server.figures.plot import Plot
from server.figures.report import Section, Table, plot_or_reason
from server.figures.sheet import Sheet
from server.figures.style import (
    INK,
    NothingToDrawError,
    axis,
    fixed,
    load_text,
    plain,
    rgba,
)

_MOST, _ACROSS, _PANEL, _GAP, _HEAD = 6, 3, 170, 48, 30  # panels, in a row; [px] height, beside, above
_MARGINS = (66, 20, 106, 72)  # [px]
_COLOR, _PALE, _LAW = "#00629b", "#8a8f98", "#b84f00"
# So that law and curve are seen at every tendon and joint of a finger.
_MOST_WITH_LAW = 18
# Where no shared law was looked for.
NO_LAW = (
    "No shared law is looked for where fingers have other tendons or joints, all are of one specimen, or a session has "
    "a fault."
)
_WHAT = {"arms": "error of a moment arm [mm]", "tension": "error of a tension [1]", "force": "error of a force [N]"}


def leading(answer: Answer) -> Answer:
    """Return the most evident curve."""
    found = rows(answer, "shared", "curves")
    if not found:
        raise NothingToDrawError(NO_LAW)
    return found[0]


def curve_figure(answer: Answer) -> go.Figure:
    """Draw the shared curve of the tendons and joints that carry it, each session's own behind it.

    Args:
        answer: of a diagnosis of several sessions.

    Raises:
        NothingToDrawError: nothing could be shared.
    """
    return _curve(
        leading(answer),
        "shared by all",
        "What the sessions share, by tendon and joint",
        "Smooth over postures; band: two standard deviations. Nat: ln evidence lost without the panel's part.",
    )


def own_curve_figure(answer: Answer) -> go.Figure:
    """Draw where the misfit of one session lives that no effect explains: an error by tendon and joint.

    Args:
        answer: of a diagnosis of one session.

    Raises:
        NothingToDrawError: something explains the readings, or what is left is not smooth.
    """
    curve = part(answer, "curve")
    whole = [p for p in rows(curve, "parts") if vector(p.get("mean")) and vector(p.get("sd"))]
    if not whole or not rows(curve, "postures_deg"):
        raise NothingToDrawError("There is no smooth curve in what is left.")
    return _curve(
        {**curve, "parts": whole},
        "of this session",
        "What no effect explains, as a smooth error by tendon and joint",
        "Over postures; band: two standard deviations. Nat: ln evidence lost without the panel's part.",
    )


def law_figure(answer: Answer) -> go.Figure:
    """Draw the best law over the shared curve with its band, for every tendon and joint.

    Args:
        answer: of a diagnosis of several sessions.

    Raises:
        NothingToDrawError: nothing could be shared, or no law helps a specimen that it is not learned from.
    """
    curve, laws = leading(answer), rows(answer, "shared", "laws")
    found = rows(curve, "parts")
    drawn = laws[0].get("curve") if laws else None
    if not isinstance(drawn, list) or len(drawn) != len(found):
        raise NothingToDrawError("No law helps a specimen that it is not learned from.")
    with_law: list[Answer] = [{**p, "own": {}, "law": law} for p, law in zip(found, drawn, strict=True)]
    if len(with_law) > _MOST_WITH_LAW:
        with_law = _evident(with_law)[:_MOST_WITH_LAW]
    law = laws[0]
    size = with_unit(f"{shown(law, 'value', 3)} ± {shown(law, 'sd')}", str(law.get("unit")))
    return _curve(
        {**curve, "parts": with_law},
        "shared by all",
        f"Law against curve: {plain(law.get('formula'))}",
        f"k = {plain(size)}. The law as these readings would show it, smoothed as the curve is; band: two standard "
        "deviations of the curve.",
    )


def _evident(found: Sequence[Answer]) -> list[Answer]:
    return sorted(found, key=lambda p: -(value(p.get("log_evidence_lost")) or 0.0))


def _curve(curve: Answer, name: str, title: str, subtitle: str) -> go.Figure:
    parts = rows(curve, "parts")
    if not any("law" in p for p in parts):
        parts = _evident(parts)[:_MOST]
    postures = [{r: a for r, a in p.items() if r != "abduction"} for p in rows(curve, "postures_deg")]
    names = ["/".join(fixed(value(a) or 0.0, 0) for a in p.values()) for p in postures]
    order = sorted(range(len(postures)), key=lambda i: [value(a) or 0.0 for a in postures[i].values()])
    rotations = "/".join(plain(r) for r in postures[0])
    sheet = Sheet(-(-len(parts) // _ACROSS) * (_PANEL + _HEAD), _MARGINS, showlegend=True)
    x = [names[i] for i in order]
    for k, found in enumerate(parts):
        row, column = divmod(k, _ACROSS)
        lowest = k + _ACROSS >= len(parts)
        lost = shown(found, "log_evidence_lost", 1)
        # An error of a tension is of no joint.
        place = plain(f"{found.get('muscle')} {found.get('joint') or ''}")
        axes = sheet.panel(
            axis(f"{rotations} [°]" if lowest else "", type="category", showticklabels=lowest),
            axis(_WHAT.get(str(curve.get("stage")), "") if column == 0 else "", zeroline=True, zerolinecolor=INK),
            **sheet.grid(row, column, _ACROSS, _PANEL, (_GAP, _HEAD), _HEAD),
            heading=f"{place}, {lost} nat",
            above=0,
        )

        pale = {"line": {"color": _PALE, "width": 1}, "marker": {"size": 4, "color": _PALE}}
        strong = {"line": {"color": _COLOR, "width": 2.5}, "marker": {"size": 6, "color": _COLOR}}
        dashed = {
            "line": {"color": _LAW, "width": 2.5, "dash": "6px,4px"},
            "marker": {"size": 7, "color": _LAW, "symbol": "diamond-open"},
        }
        own = [
            (vector(y) or [], "each session alone", "own", pale, f"{plain(session)}: ", k == 0 and n == 0)
            for n, (session, y) in enumerate(part(found, "own").items())
        ]
        mean, sd, law = (vector(found.get(key)) or [] for key in ("mean", "sd", "law"))
        courses = [*own, (mean, name, "shared", strong, "", k == 0)]
        courses += [(law, "the law", "law", dashed, "law: ", k == 0)] if law else []
        drawn = [
            go.Scatter(
                x=x,
                y=[y[i] for i in order],
                mode="lines+markers",
                name=called,
                showlegend=named,
                legendgroup=group,
                hovertemplate=f"{said}%{{y:.2f}}<extra></extra>",
                **look,
                **axes,
            )
            for y, called, group, look, said, named in courses
        ]
        high, low = [mean[i] + 2.0 * sd[i] for i in order], [mean[i] - 2.0 * sd[i] for i in order]
        # The band lies over the sessions' own courses and below the rest.
        sheet.data += [*drawn[: len(own)], marks.band(x, low, high, rgba(_COLOR, 0.16), axes), *drawn[len(own) :]]
    return sheet.drawn(title, subtitle, legend_px=6)


def chance_figure(answer: Answer) -> go.Figure:
    """Draw what sharing gains after shuffles, and as the sessions are.

    Raises:
        NothingToDrawError: nothing was shuffled.
    """
    shared = part(answer, "shared")
    shuffled, gained = vector(shared.get("shuffled_gain")) or [], value(shared.get("gain"))
    if not shuffled or gained is None:
        raise NothingToDrawError("Nothing was shuffled (--permutations 0).")
    counts, edges = np.histogram(shuffled, bins=25)
    middle = 0.5 * (edges[1:] + edges[:-1])
    bars = go.Bar(
        x=middle.tolist(),
        y=counts.tolist(),
        width=float(0.92 * (edges[1] - edges[0])),
        marker={"color": _PALE},
        name="shuffled",
        hovertemplate="%{x:.1f} nat: %{y}<extra></extra>",
    )
    line = go.Scatter(
        x=[gained, gained],
        y=[0, int(counts.max())],
        mode="lines",
        line={"color": _COLOR, "width": 3},
        name="as the sessions are",
        hovertemplate=f"{gained:.1f} nat<extra></extra>",
    )
    sheet = Sheet(240, _MARGINS, showlegend=True)
    sheet.panel(axis("gain of sharing [nat]"), axis("shuffles"))
    sheet.data += [bars, line]
    chance = shown(shared, "permutation_p", 3)
    return sheet.drawn(
        "Would chance do as well?",
        f"Tendons and signs of each session shuffled, {len(shuffled)} times; p = {chance}.",
        legend_px=6,
    )


def laws_tables(answer: Answer) -> list[Table]:
    """Tabulate the laws that the curve resembles, and what each adds to the specimen that it was not learned from."""
    laws, left_out = [], []
    for law in rows(answer, "shared", "laws"):
        size = f"{shown(law, 'value', 3)} ± {shown(law, 'sd')}"
        named, rivals = str(law.get("formula")), "; ".join(words(law.get("rivals"))[:4])
        laws.append([named, with_unit(size, str(law.get("unit"))), shown(law, "agreement"), rivals])
        gains = part(law, "left_out_gain")
        for session in words(answer.get("sessions")):
            errors = part(law, "unseen_rmse_N", session)
            falls = [_fall(part(errors, place)) for place in ("tip", "bone")]
            left_out.append([named, session, fixed(value(gains.get(session)) or 0.0, 1), *falls])
            named = ""
    if not laws:
        return []
    return [
        Table(
            ["law", "value of all", "agreement", "not to be parted from"],
            laws,
            "One coefficient k for all sessions. Agreement: mean squared distance of the sessions' own values from the "
            "common one, 1 is chance.",
        ),
        Table(
            ["law", "left out", "gain [nat]", "tip [N]", "bone [N]"],
            left_out,
            "Each law learned from the other specimens: ln density that it adds to the one left out, and RMSE of its "
            "validation forces, before → after.",
        ),
    ]


def _deciding(shared: Answer) -> list[str | Table]:
    """Tabulate the load cases that would separate the laws."""
    found = part(shared, "would_decide")
    lines = [
        [
            text(r, "posture", "–").replace("_", " "),
            text(r, "location", "–"),
            load_text(masses_of(r)),
            text(r, "reading", "–"),
            shown(r, "information_nat"),
        ]
        for r in rows(found, "readings")
    ]
    if not lines:
        return ["No load case that this rig has shown parts these laws."]
    caption = (
        f"On a specimen like {found.get('on')}, best first. Information: what a reading should tell of the law; "
        "0.69 nat (ln 2) decide between two that are equally probable."
    )
    between = [f"Held against each other: {'; '.join(names)}."] if (names := words(found.get("between"))) else []
    return [*between, Table(["posture", "at", "hang", "read", "information [nat]"], lines, caption)]


def _fall(errors: Answer) -> str:
    return " → ".join(shown(errors, key, 3) for key in ("before", "after"))


def _law_sections(answer: Answer, drawn: Plot | str) -> list[Section]:
    """Return what the curve resembles, with the law's figure, and what would decide."""
    tables = laws_tables(answer) or ("None helps a specimen that it is not learned from.",)
    return [
        Section("Which law it resembles", [*tables, drawn]),
        Section("What would decide", _deciding(part(answer, "shared"))),
    ]


# Figures of several sessions by name, each with its caption.
FIGURES = {
    "shared_curve": (curve_figure, "Beside each session's anatomy, budget, noise and scatter."),
    "shared_chance": (chance_figure, "Chance gains as much in any order."),
    "shared_law": (law_figure, "Where the two part, the law is not all of the curve."),
}


def shared_sections(answer: Answer) -> list[Section]:
    """Return the parts of the page of several sessions."""

    def picture(name: str) -> Plot | str:
        draw, caption = FIGURES[name]
        return plot_or_reason(name, lambda: draw(answer), caption)

    shared = part(answer, "shared")
    sentences = [
        *map(warning_line, rows(answer, "warnings")),
        str(answer.get("sentence") or ""),
        *(f"Short of more: {s}." for s in words(answer.get("short"))),
    ]
    each = part(answer, "each")
    lacking = words(shared.get("lacking"))
    return [
        Section("Together", sentences),
        Section(
            "Beyond the catalogue",
            [
                str(shared.get("sentence") or NO_LAW),
                *([f"It does not help {', '.join(lacking)}."] if lacking else []),
                picture("shared_curve"),
                picture("shared_chance"),
            ],
        ),
        *(_law_sections(answer, picture("shared_law")) if shared.get("found") or rows(shared, "laws") else ()),
        Section("Each by itself", [f"{name}: {part(each, name).get('sentence')}" for name in each]),
    ]
