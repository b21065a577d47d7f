"""`fingertwin add` and `fingertwin effects`: put effects into a model, take them out, and look them up."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.files import require_writable
from daq.quoting import quoted
from daq.sessions import require_once
from fingermodel.effects.catalogue import CATALOGUE, EFFECTS
from fingermodel.effects.formula_tree import near
from fingermodel.effects.user import shipped_effects
from fingermodel.model_files import free_path, require_new
from fingermodel.revisions import save_revision
from fingermodel.session import Session
from server.application.additions import add_bench, addition_body, addition_step, refitted_alone, resolved_effects
from server.application.catalogue import effect_row
from server.application.drawing import draw_comparison
from server.commands.console import answer, progress, say, table
from server.commands.twin import print_fall, print_fit, say_first

if TYPE_CHECKING:
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
    effects, session = names[:-1], names[-1]
    if not effects and not without:
        raise InputError(f"only {session!r} is given", "effects and then a session: fingertwin add hanger_mass DEV-02")
    if session in EFFECTS and effects and effects[0] not in EFFECTS:
        right = " ".join(["fingertwin add", *map(quoted, [*effects[1:], session, effects[0]])])
        raise InputError(f"{session} is no session", "effects first, then the session", right)
    if shared and (out is not None or model is not None):
        raise InputError("--shared with --out or --model", "neither: each session has a model of its own")
    require_once([session, *shared])
    if out is not None:
        require_new(out)
    require_writable(out or Path("models"), folder=out is None)
    chosen, own = resolved_effects(effects)
    benches, bodies = {}, {}
    # A session that cannot be read ends the command before anything is kept.
    for one in [session, *shared]:
        with progress("Reading and correcting") as tell:
            benches[one] = Session.open(one, model, progress=tell, effects=own)
    for one, bench in benches.items():
        folder = figures / one if figures and shared else figures
        bodies[one] = _add_to_session(chosen, bench, one, without, out, folder, quiet=json is not None)
    if json is not None:
        answer("add", {"sessions": bodies} if shared else bodies[session], json)


def _add_to_session(
    chosen: list[str],
    bench: Session,
    session: str,
    without: list[str],
    out: Path | None,
    figures: Path | None,
    *,
    quiet: bool,
) -> dict[str, Any]:
    """Add effects to a session's model, refit, write the revision and show the fall of the error."""
    with progress("Refitting") as tell:
        before, addition, after = add_bench(bench, chosen, without, tell)
    alone = refitted_alone(bench, addition)
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
        name = " + ".join(addition.names)
        page = draw_comparison(bench, after, figures, before=before, theta=addition.fit.theta, model_name=name)
    body = addition_body(bench, addition, before, alone, after, without) | {
        "history": document["history"],
        "model": str(path),
    }
    if quiet:
        return body
    say_first(body)
    if addition.log_evidence_gain is not None:
        say(f"Evidence: ln Z {moved(addition.log_evidence_gain)} with {', '.join(addition.names)}")
    print_history(document["history"])
    say(f"Model: {path}   (fingertwin diagnose {quoted(session)} --model {quoted(path)})")
    print_fall(before, alone, after, without=addition.fit.errors.not_counted)
    print_fit(addition.fit, body["mounts"])
    if page:
        say(f"Figures: {page}")
    return body


def moved(gain: float) -> str:
    """Say by how much ln evidence rises or falls, as it is printed."""
    return f"{'falls' if round(gain, 1) < 0.0 else 'rises'} by {abs(gain):.1f}"


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


def _effect_of(name: str) -> Effect:
    if name in EFFECTS:
        return EFFECTS[name]
    _, own = resolved_effects([name])
    if not own:
        known = [*EFFECTS, *shipped_effects()]
        raise InputError(f"no effect {name!r}", f"one of {', '.join(known)}, or a file", near(name, known))
    return own[0]


def _list_effects(json: str | None) -> None:
    _, ready_made = resolved_effects(shipped_effects())
    listed = {"effects": CATALOGUE, "ready_made": ready_made}
    rows = {key: [effect_row(effect) for effect in effects] for key, effects in listed.items()}
    if answer("effects", rows, json):
        return
    for title, key in (("Catalogue of effects", "effects"), ("Ready-made, beside the catalogue", "ready_made")):
        table(title, ["name", "stage", "what happens"], [[r["name"], r["stage"], r["title"]] for r in rows[key]])
    say("fingertwin effects NAME shows formula, parameters, ranges and source; NAME may be a file of your own.")


def show_effects(name: str | None, json: str | None) -> None:
    """List the catalogue and the ready-made effects, or show one effect whole: whatever `add` takes.

    Raises:
        InputError: there is no such effect, or its file cannot be used.
    """
    if name is None:
        _list_effects(json)
        return
    row = effect_row(_effect_of(name))
    if answer("effects", {"effects": [row]}, json):
        return
    say(f"{row['name']} ({row['stage']}): {row['title']}")
    say(f"  formula: {row['formula']}")
    if row["tell"]:
        say(f"  given away by: {row['tell']}")
    say(f"  source: {row['source']}")
    if row["rests_on_clamp_assumption"]:
        say("  only out-of-plane forces support it, which a real clamp carries in part")
    table(
        "Parameters",
        ["name", "unit", "null", "from", "to", "prior sd"],
        [[p["name"], p["unit"], p["null"], *(p["range"] or (None, None)), p["prior_sd"]] for p in row["parameters"]],
    )
