"""Figures of a diagnosis as one HTML page, and as PNG and SVG, from nothing but its answer.

The answer is the JSON of `fingertwin diagnose`, so that the page can be drawn anew from a saved file. Whatever the
answer lacks is said to be absent; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from server.application.provenance import told_first
from server.figures import diagnosis_tables as tables
from server.figures import diagnosis_words as said
from server.figures import graph_objects as go
from server.figures.diagnosis_answer import value, words
from server.figures.diagnosis_confounding import confounding_figure
from server.figures.diagnosis_held_out import held_out_figure
from server.figures.diagnosis_map import residual_map
from server.figures.diagnosis_ranking import ranking_figure
from server.figures.diagnosis_revisions import revisions_figure
from server.figures.diagnosis_sensitivity import sensitivity_figure
from server.figures.diagnosis_size import size_figure
from server.figures.diagnosis_torque import torque_figure
from server.figures.diagnosis_words import title
from server.figures.plot import Plot
from server.figures.report import Section, Steps, Table, plot_or_reason, write_report
from server.figures.report_front import closing_sections, finger_section, folded, read_first, to_do
from server.figures.shared_law import own_curve_figure, shared_sections
from server.figures.style import number

History = Sequence[Mapping[str, Any]]

# Figures of a diagnosis by name, drawn from its answer and the model's history, each with its caption.
FIGURES: dict[str, tuple[Callable[[Mapping[str, Any], History | None], go.Figure], str]] = {
    "sensitivity": (
        lambda answer, _: sensitivity_figure(answer),
        "Each dot is asked of the linearised models; nothing is refitted. It conditions no verdict.",
    ),
    "residual_map": (
        lambda answer, _: residual_map(answer),
        "The colours mean the same in every report: pale within noise, darkest from twenty standard uncertainties on.",
    ),
    "missing_torque": (
        lambda answer, _: torque_figure(answer),
        "All joints on one scale, so that what matters most stands out.",
    ),
    "ranking": (
        lambda answer, _: ranking_figure(answer),
        "Evidence is counted against nothing missing. The RMSE is that of the validation cases.",
    ),
    "size": (
        lambda answer, _: size_figure(answer),
        "The force with the effect less the force without it, as fitted, under one tendon at a time.",
    ),
    "confounding": (
        lambda answer, _: confounding_figure(answer),
        "Largest canonical correlation of what two effects do to the readings, after tendon points and budget have "
        "taken up what they can.",
    ),
    "revisions": (revisions_figure, "Identification cases are fitted, validation cases never."),
    "held_out": (
        lambda answer, _: held_out_figure(answer),
        "Grey marks: the measurement's own standard uncertainty; a residual to their left is within it.",
    ),
    "own_curve": (
        lambda answer, _: own_curve_figure(answer),
        "Beside anatomy, budget, noise and scatter, at the stage that is likeliest.",
    ),
}


def draw_diagnosis(
    answer: dict[str, Any],
    folder: Path,
    history: list[dict[str, Any]] | None = None,
    static: bool = True,
    finger: go.Figure | None = None,
) -> Path:
    """Draw a diagnosis and return its page.

    Args:
        answer: of `fingertwin diagnose`; its `judged_in` (`sagittal`, else space) says in which plane the errors of
            cases and roles are drawn.
        folder: for `diagnose.html`, PNG and SVG; made where it is absent.
        history: of the model's revisions, oldest first: `added`, `removed`, `log_evidence_gain`, `rmse_N`.
        static: whether to write PNG and SVG too.
        finger: with the effect, for the first page.
    """
    sections = [*diagnosis_sections(answer, history, finger), *closing_sections(answer.get("origin") or {})]
    return write_report(folder / "diagnose.html", sections, title(answer), subtitle(answer), static=static)


def subtitle(answer: Mapping[str, Any]) -> str:
    """Return the line below a report's title: model, specimen, date and version, as far as they are known."""
    origin = answer.get("origin") or {}
    told = {"Model": answer.get("model"), "Specimen": origin.get("specimen"), "Made": origin.get("made")}
    by = f", by {origin['software']}" if origin.get("software") else ""
    return ". ".join(f"{k}: {v}" for k, v in told.items() if v) + by


def diagnosis_sections(
    answer: Mapping[str, Any], history: History | None, finger: go.Figure | None = None
) -> list[Section]:
    """Return the page's parts, the first page unfolded; on it a drawing of the finger with the effect, if given."""

    def picture(name: str) -> Plot | str:
        draw, caption = FIGURES[name]
        return plot_or_reason(name, lambda: draw(answer, history), caption)

    def or_else(found: Sequence[Table], otherwise: str, key: str = "") -> Sequence[Table | str]:
        return found or [otherwise if not key or key in answer else "Not worked out for this answer."]

    cases = said.counts(answer)
    caption = "The load case that it changes most. Solid: measured, dashed: predicted with it, dotted: without it."
    first = [
        *read_first(told_first(answer)),
        Section("Verdict", said.verdict_sentences(answer)),
        Section("What to do", [Steps(to_do(answer))]),
        Section("Error before and after", or_else(tables.error_table(answer), "No error before or after is stated.")),
        *finger_section(answer, None if finger is None else Plot("finger", "", finger, caption)),
    ]
    details = [
        Section(
            "Suspect load cases and the rig",
            [
                *said.suspect_sentences(answer),
                *tables.suspects_table(answer),
                *said.fault_sentences(answer),
                *tables.rig_table(answer),
            ],
        ),
        Section(
            "Sensitivity analysis",
            [
                *said.robustness_sentences(answer),
                picture("sensitivity"),
            ],
        ),
        Section(
            "Where the model fails",
            [
                *([cases] if cases else []),
                picture("residual_map"),
                *tables.bent_table(answer),
                *tables.where_table(answer),
                *said.torque_sentences(answer),
                picture("missing_torque"),
                *tables.torque_table(answer),
            ],
        ),
        Section(
            "Which explanation",
            [
                picture("ranking"),
                *tables.ranking_table(answer),
                *tables.parameter_table(answer),
                *tables.inclusion_table(answer),
                *said.beyond_sentences(answer),
                picture("size"),
            ],
        ),
        Section(
            "What cannot be told apart",
            [
                *said.confounding_sentences(answer),
                picture("confounding"),
            ],
        ),
        Section(
            "Tests that need no model",
            [
                *words(answer.get("nulls_beside")),
                *or_else(tables.nulls_table(answer), "None: the session's load cases allow no such test.", "nulls"),
            ],
        ),
        Section(
            "The fall of the error",
            [
                picture("revisions"),
                *tables.revision_table(answer, history),
                picture("held_out"),
                *tables.held_out_table(answer),
                *said.predictive_sentences(answer),
            ],
        ),
        Section(
            "Hints at a formula",
            [
                *said.curve_sentences(answer),
                picture("own_curve"),
                *tables.ready_made_table(answer),
                *or_else(tables.hints_table(answer), "None: no simple formula takes up what is left.", "hints"),
            ],
        ),
        Section(
            "Load cases to run next",
            or_else(
                tables.next_cases_table(answer),
                "None: no available load case would tell the explanations apart.",
                "next_cases",
            ),
        ),
        Section("How this was found", [*said.misfit_sentences(answer), *said.METHOD, *_duration(answer)]),
    ]
    return [*first, *folded(details)]


def _duration(answer: Mapping[str, Any]) -> list[str]:
    seconds = value(answer.get("seconds"))
    return [] if seconds is None else [f"The diagnosis took {number(seconds, 1)} s."]


def draw_shared(answer: dict[str, Any], folder: Path, static: bool = True) -> Path:
    """Draw what several sessions share and return its page.

    Args:
        answer: of `fingertwin diagnose` of several sessions.
        folder: for `shared.html`, PNG and SVG; made where it is absent.
        static: whether to write PNG and SVG too.
    """
    name = f"What {len(answer['sessions'])} sessions share"
    return write_report(folder / "shared.html", shared_sections(answer), name, static=static)
