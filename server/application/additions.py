"""Effects put into a session's model and taken out of it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fingermodel import add, comparing
from fingermodel.comparison.comparison import Comparison, compare
from fingermodel.diagnosis.answer.addition import Addition
from fingermodel.effects.formula import formula_effect
from fingermodel.effects.formula_language import one_line
from fingermodel.effects.user import load_effect, shipped_effects
from fingermodel.model_files import Step
from fingermodel.session import Progress, Session
from server.application.provenance import provenance
from server.application.refitting import fit_body

if TYPE_CHECKING:
    from fingermodel.fitting.fit_report import Fit
    from fingermodel.stages import Effect


def add_bench(
    bench: Session, names: Sequence[str], without: Sequence[str], tell: Progress | None = None
) -> tuple[Comparison, Addition, Comparison]:
    """Refit with effects added and others taken out; errors before are those of the model as it was given.

    Both comparisons are of the cases that count.
    """
    addition = add(bench, *names, without=without, progress=tell)
    apart = addition.fit.errors.not_counted
    return comparing.compare(bench).without(apart), addition, _compared(bench, addition.fit)


def refitted_alone(bench: Session, addition: Addition) -> Comparison | None:
    """Compare the model refitted without what was added; None where nothing was."""
    return None if addition.alone is None else _compared(bench, addition.alone)


def _compared(bench: Session, fit: Fit) -> Comparison:
    return compare(bench.model, bench.observations, fit.theta).without(fit.errors.not_counted)


def addition_step(addition: Addition, without: Sequence[str], alone: Comparison | None) -> Step:
    """Return the changes of an addition, for its revision."""
    evidence = {"log_evidence_gain": addition.log_evidence_gain}
    told = None if alone is None else alone.summary()
    return Step(added=addition.names, removed=tuple(without), evidence=evidence, alone=told)


def addition_body(
    bench: Session,
    addition: Addition,
    before: Comparison,
    alone: Comparison | None,
    after: Comparison,
    without: Sequence[str],
) -> dict[str, Any]:
    """Return the contract's answer, without the model's path and history."""
    return (
        provenance(bench)
        | fit_body(bench, addition.fit, before, after)
        | {
            "refitted_alone": None if alone is None else alone.summary(),
            "added": list(addition.names),
            "removed": list(without),
            "log_evidence_gain": addition.log_evidence_gain,
        }
    )


def resolved_effects(given: Sequence[str], *, files: bool = True) -> tuple[list[str], list[Effect]]:
    """Return names of effects, and the user's own among them: from files, shipped ones by name, or a formula in quotes.

    Args:
        given: as on the command line.
        files: whether paths are followed; otherwise they are names like any other.
    """
    names: list[str] = []
    own: list[Effect] = []
    shipped = set(shipped_effects())
    for text in given:
        if "=" in text:
            effect = formula_of(text)
        elif text in shipped or (files and text.endswith((".yaml", ".yml", ".py"))):
            effect = load_effect(Path(text))
        else:
            names.append(text)
            continue
        own.append(effect)
        names.append(effect.name)
    return names, own


def formula_of(text: str) -> Effect:
    """Make an effect of a formula with one coefficient k, as a hint prints it; unit and range follow from its place.

    Its name is of its place and its text, so that several may be tried at one place.
    """
    text = one_line(text)
    left, _, right = text.partition("=")
    left = left.rstrip("+* ")
    if left.startswith("torque") and "*=" not in text:
        unit, reach = ("mm", 4.0) if "t_" in right else ("N mm", 20.0)
        factors = [f.strip() for f in right.split("*")]
        if len([f for f in factors if f.startswith("t_")]) == 2:
            unit, reach = "mm/N", 0.6
    elif "*=" in text:
        unit, reach = "1", 0.2
    elif left.startswith("force") and "F_" not in right:
        unit, reach = "N", 1.0
    else:
        unit, reach = "1", 0.2
    place = "".join(c if c.isalnum() else "_" for c in left).strip("_").lower()
    digest = hashlib.sha256(text.encode()).hexdigest()[:4]
    document = {
        "format": "fingertwin-effect/1",
        "name": f"own_{place}_{digest}",
        "title": f"a term of the user's in {left}",
        "source": "given as a formula",
        "formula": text,
        "parameters": {"k": {"unit": unit, "range": [-reach, reach]}},
    }
    return formula_effect(document, f"formula {text!r}")
