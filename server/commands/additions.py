"""`fingertwin add` and `fingertwin effects`: put effects into a model, take them out, and look them up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from server.application.workflow import Bench, Progress, compare_bench, open_bench, save_revision
from server.commands.console import answer, progress, say, table
from server.commands.twin import fit_body, print_fall, print_fit, provenance, refit_compared, say_first

if TYPE_CHECKING:
    from fingermodel.comparison import Comparison
    from fingermodel.diagnosis.answer.addition import Addition
    from fingermodel.model_files import Step
    from fingermodel.stages import Effect


def add_to_sessions(
    names: list[str],
    shared: list[str],
    without: list[str],
    model: str | None,
    out: Path | None,
    figures: Path | None,
    json: str | None,
) -> None:
    """Add effects to the models of one session or several, each with a value of its own."""
    from fingermodel.effects.catalogue import EFFECTS

    effects, session = names[:-1], names[-1]
    if not effects and not without:
        raise InputError(f"only {session!r} is given", "effects and then a session: fingertwin add hanger_mass DEV-02")
    if session in EFFECTS and effects and effects[0] not in EFFECTS:
        right = " ".join(["fingertwin add", *effects[1:], session, effects[0]])
        raise InputError(f"{session} is no session", "effects first, then the session", right)
    if shared and (out is not None or model is not None):
        raise InputError("--shared with --out or --model", "neither: each session has a model of its own")
    if len({session, *shared}) <= len(shared):
        raise InputError("a session is given twice", "each session once")
    bodies = {}
    for one in [session, *shared]:
        folder = figures / one if figures and shared else figures
        bodies[one] = _add_to_session(effects, one, without, model, out, folder, quiet=json is not None)
    if json is not None:
        answer("add", {"sessions": bodies} if shared else bodies[session], json)


def _add_to_session(
    effects: list[str],
    session: str,
    without: list[str],
    model: str | None,
    out: Path | None,
    figures: Path | None,
    *,
    quiet: bool,
) -> dict[str, Any]:
    """Add effects to a session's model, refit, write the revision and show the fall of the error."""
    from fingermodel.model_files import free_path, require_new

    if out is not None:
        require_new(out)
    chosen, own = resolved_effects(effects)
    with progress("Reading and correcting") as tell:
        bench = open_bench(session, model, tell, catalogue=True, effects=own)
    with progress("Refitting") as tell:
        before, addition, after = add_bench(bench, chosen, without, tell)
    with progress("Refitting without it") as tell:
        alone = refitted_alone(bench, addition.names, without, tell)
    path = out or free_path(Path("models"), bench.measured.session.id)
    document = save_revision(
        bench,
        addition.fit,
        path,
        before.summary(),
        after.summary(),
        addition_step(addition, without, alone),
    )
    page = None
    if figures:
        from server.application.drawing import draw_comparison

        page = draw_comparison(
            bench, after, figures, before=before, theta=addition.fit.theta, model_name=" + ".join(addition.names)
        )
    body = addition_body(bench, addition, before, alone, after, without) | {
        "history": document["history"],
        "model": str(path),
    }
    if quiet:
        return body
    say_first(body)
    if addition.names:
        say(f"Evidence: ln Z rises by {addition.log_evidence_gain:.1f} with {', '.join(addition.names)}")
    print_history(document["history"])
    say(f"Model: {path}   (fingertwin diagnose {session} --model {path})")
    print_fall(before, alone, after)
    print_fit(addition.fit)
    if page:
        say(f"Figures: {page}")
    return body


def add_bench(
    bench: Bench, names: Sequence[str], without: Sequence[str], tell: Progress | None = None
) -> tuple[Comparison, Addition, Comparison]:
    """Refit with effects added and others taken out; errors before are those of the model as it was given."""
    from fingermodel.comparison import compare
    from fingermodel.diagnosis.answer.addition import add_effects

    held = _held(bench, without)
    before = compare_bench(bench)
    own = bench.loaded.name == bench.model.finger.id
    start = None if own else bench.theta
    addition = add_effects(bench.model, bench.observations, names, held=held, start=start, progress=tell)
    return before, addition, compare(bench.model, bench.observations, addition.fit.theta)


def refitted_alone(
    bench: Bench, names: Sequence[str], without: Sequence[str], tell: Progress | None = None
) -> Comparison | None:
    """Compare the model refitted without what is to be added; None where nothing is."""
    if not names:
        return None
    bare = replace(bench, loaded=replace(bench.loaded, added=_held(bench, without)))
    return refit_compared(bare, tell=tell)[2]


def _held(bench: Bench, without: Sequence[str]) -> tuple[str, ...]:
    """Parameters of effects that the model holds and keeps.

    Raises:
        InputError: an effect is to be taken out that it does not hold.
    """
    unknown = [w for w in without if not any(_matches(p, [w]) for p in bench.loaded.added)]
    if unknown:
        has = sorted({p.split(".")[0] for p in bench.loaded.added})
        raise InputError(
            f"the model has no {unknown[0]} to take out", f"one of {', '.join(has) or 'none: it has no effect'}"
        )
    return tuple(p for p in bench.loaded.added if not _matches(p, without))


def addition_step(addition: Addition, without: Sequence[str], alone: Comparison | None) -> Step:
    """What an addition changed, for its revision."""
    from fingermodel.model_files import Step

    evidence = {"log_evidence_gain": addition.log_evidence_gain}
    told = None if alone is None else alone.summary()
    return Step(added=addition.names, removed=tuple(without), evidence=evidence, alone=told)


def addition_body(
    bench: Bench,
    addition: Addition,
    before: Comparison,
    alone: Comparison | None,
    after: Comparison,
    without: Sequence[str],
) -> dict[str, Any]:
    """The contract's answer, without the model's path and history."""
    return (
        provenance(bench)
        | fit_body(addition.fit, before, after)
        | {
            "refitted_alone": None if alone is None else alone.summary(),
            "added": list(addition.names),
            "removed": list(without),
            "log_evidence_gain": addition.log_evidence_gain,
        }
    )


def print_history(history: list[dict[str, Any]]) -> None:
    """Print the chain of revisions: what each added, on what evidence, and the errors after it."""
    places = list(history[-1]["rmse_N"])
    rows = []
    for step in history:
        change = " ".join([*(f"+{a}" for a in step["added"]), *(f"-{r}" for r in step["removed"])])
        errors = [step["rmse_N"].get(p) for p in places]
        start = step is history[0]
        name = step["id"] or "not kept"
        rows.append([change or ("start" if start else "refit"), step["log_evidence_gain"], *errors, name])
    roles = {"identification": "fitted", "validation": "unseen"}
    headers = [" ".join(roles.get(word, word) for word in place.split("/")) for place in places]
    table(
        "Fall of the error: RMSE [N] of the cases that are fitted, and of the validation cases",
        ["change", "ln evidence", *headers, "revision"],
        rows,
    )


def _matches(parameter: str, names: Sequence[str]) -> bool:
    return any(parameter == n or parameter.startswith(f"{n}.") for n in names)


def resolved_effects(given: Sequence[str], *, files: bool = True) -> tuple[list[str], list[Effect]]:
    """Names of effects, and the user's own among them: from files, shipped ones by name, or a formula in quotes.

    Args:
        given: as on the command line.
        files: whether paths are followed; otherwise they are names like any other.
    """
    from fingermodel.effects.user import load_effect, shipped_effects

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
    """Make an effect of a formula with one coefficient k, as a hint prints it; unit and range follow from its place."""
    from fingermodel.effects.formula import formula_effect

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
    name = "".join(c if c.isalnum() else "_" for c in left).strip("_").lower()
    document = {
        "format": "fingertwin-effect/1",
        "name": f"own_{name}",
        "title": f"a term of the user's in {left}",
        "source": "given as a formula",
        "formula": text,
        "parameters": {"k": {"unit": unit, "range": [-reach, reach]}},
    }
    return formula_effect(document, f"formula {text!r}")


def show_effects(name: str | None, json: str | None) -> None:
    """List the catalogue, or show one effect whole."""
    from fingermodel.effects.catalogue import CATALOGUE, EFFECTS
    from server.application.catalogue import effect_row

    if name is not None and name not in EFFECTS:
        from fingermodel.effects.formula_tree import near

        raise InputError(f"no effect {name!r}", f"one of {', '.join(EFFECTS)}", near(name, EFFECTS))
    chosen = CATALOGUE if name is None else (EFFECTS[name],)
    rows = [effect_row(effect) for effect in chosen]
    if answer("effects", {"effects": rows}, json):
        return
    if name is None:
        table(
            "Catalogue of effects",
            ["name", "stage", "what happens"],
            [[r["name"], r["stage"], r["title"]] for r in rows],
        )
        say("fingertwin effects NAME shows formula, parameters, ranges and source.")
        return
    row = rows[0]
    say(f"{row['name']} ({row['stage']}): {row['title']}")
    say(f"  formula: {row['formula']}")
    say(f"  given away by: {row['tell']}")
    say(f"  source: {row['source']}")
    if row["rests_on_clamp_assumption"]:
        say("  only out-of-plane forces support it, which a real clamp carries in part")
    table(
        "Parameters",
        ["name", "unit", "null", "from", "to", "prior sd"],
        [[p["name"], p["unit"], p["null"], *(p["range"] or (None, None)), p["prior_sd"]] for p in row["parameters"]],
    )
