"""`fingertwin diagnose`: where a session's model fails and which effect is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.quoting import quoted
from daq.signals.corrections import as_entered
from fingermodel.parameters import with_unit
from fingermodel.session import Session, readings_digest
from server.application.diagnosing import bare_verdict, diagnosis_answer, drawn_effect, frozen_documents, run_diagnosis
from server.application.diagnosis_report import draw_diagnosis
from server.application.provenance import origin_of
from server.commands.console import answer, progress, say, table
from server.commands.twin import say_first

# Probabilities below this are not printed.
_TOLD = 0.02


def diagnose_session(
    session: str,
    model: str | None,
    thorough: bool,
    effects: list[str],
    frozen: list[Path] | None,
    figures: Path | None,
    json: str | None,
) -> None:
    """Diagnose one session and show it."""
    with progress("Reading and correcting") as tell:
        bench = Session.open(session, model, progress=tell, effects=effects)
    predictions = frozen_documents(bench, frozen)
    with progress("Fitting every effect") as tell:
        diagnosis = run_diagnosis(bench, thorough, tell)
    body = diagnosis_answer(bench, diagnosis, predictions)
    if bench.measured.session.has_amended_entries:
        entered = Session.of(as_entered(bench.measured), model, effects=effects)
        with progress("The same without the amendments") as tell:
            body["without_amendments"] = bare_verdict(run_diagnosis(entered, thorough, tell))
    page = None
    if figures:
        body["origin"] = origin_of(bench, readings_digest(bench.measured))
        page = draw_diagnosis(body, figures, list(bench.loaded.history) or None, finger=drawn_effect(bench, body))
        body["figures"] = str(page)
    if answer("diagnose", body, json):
        return
    print_diagnosis(body, quoted(session))
    if page:
        say(f"Report: {page}")


def print_diagnosis(body: dict[str, Any], session: str) -> None:
    """Print what has to be known before, the verdict, then what it stands on.

    Args:
        body: the answer.
        session: as the commands to go on with name it: its folder, where that was given.
    """
    say_first(body)
    _print_verdict(body)
    _print_sensitivity(body["robustness"])
    if body.get("confirmation"):
        say(f"  Frozen predictions: {body['confirmation']['text']}.")
    _print_fall(body)
    _print_explanations(body)
    _print_where(body["where"])
    if body["nulls_beside"]:
        say(body["nulls_beside"])
    for null in body["nulls"]:
        if null["verdict"] != "not_tested":
            say(f"{'ok  ' if null['verdict'] == 'holds' else 'FAIL'} {null['text']}")
    if body["curve"]:
        say(body["curve"]["sentence"])
    _print_ways_on(body, session)
    if body["verdict"] != "nothing_missing":
        say(body["next_sentence"])


def _print_ways_on(body: dict[str, Any], session: str) -> None:
    """Print the commands by which a fault is put right, or a formula tried."""
    for fault in body["session_faults"]:
        if fault["amend"]:
            say("To put it right, once it is known:")
        for change in fault["amend"]:
            say(f'    fingertwin amend {session} {amending(change)} --why "…"')
    offers = [(known["text"], quoted(known["effect"])) for known in body["ready_made"]]
    offers += [(f"Hint: {hint['text']}", quoted(hint["effect"]["formula"])) for hint in body["hints"]]
    for text, effect in offers:
        say(f"{text}:")
        say(f"    fingertwin add {effect} {session}")


def amending(change: dict[str, Any]) -> str:
    """Write one amendment that a fault proposes as `amend` takes it."""
    tendons = [f"--tendon {true}={entered}" for entered, true in change["tendons"].items()]
    weights = [f"--weight {true:.12g}={float(entered):.12g}" for entered, true in change["weights_g"].items()]
    masses = [f"--mass {tendon}={grams:.12g}" for tendon, grams in change["masses_g"].items()]
    posture = [f"--posture {quoted(change['posture'])}"] if change["posture"] else []
    mount = [f"--mount {change['location']}"] if change["location"] else []
    return " ".join([quoted(change["cases"]), *tendons, *weights, *masses, *posture, *mount])


def suspects_of(body: dict[str, Any]) -> str:
    """Say which load cases are suspects; nothing where none is."""
    suspects = [_suspect(row) for row in body["suspects"]]
    return f"Suspect load case{'s' if len(suspects) > 1 else ''}: {', '.join(suspects)}." if suspects else ""


def _print_verdict(body: dict[str, Any]) -> None:
    say(body["sentence"])
    say(f"  Probability {body['probability']:.2f}: {body['probability_of']}.")
    if suspects := suspects_of(body):
        say(f"  {suspects}")
    said = " ".join([body["sentence"], *body["reasons"]]).casefold()
    for fault in (f for f in body["session_faults"] if f["words"].casefold() not in said):
        say(f"  The whole session: {fault['words']} (probability {fault['probability']:.2f}).")
    if entered := body.get("without_amendments"):
        say(f"  Without the amendments of entries: {entered['text']}.")
    for note in body["notes"]:
        say(f"  Note: {note}")
    for reason in body["reasons"]:
        say(f"  {reason}")
    beyond = body["beyond"]
    faulty = any(f["probability"] >= 0.5 for f in body["session_faults"])
    if beyond["probability"] >= _TOLD and not faulty:
        size = f", of about {beyond['amplitude_N']:.2f} N" if beyond["amplitude_N"] else ""
        size += "".join(
            f", in {name} alone ({p:.2f})" for name, p in beyond.get("of_one_alone", {}).items() if p >= 0.5
        )
        say(f"  Something no effect describes acts, alone or beside: probability {beyond['probability']:.2f}{size}.")
    check = body["predictive_check"]
    before, after = check["p_value_before"], check["p_value_after"]
    if before is not None and after is not None and not faulty:
        say(f"  Predictive check on the validation cases: p = {before:.2g} without any effect, {after:.2g} as judged.")


def _print_sensitivity(robust: dict[str, Any]) -> None:
    for flip in robust["flips_when"][:3]:
        say(f"  It would be less probable than not if {flip}.")
    if parts := robust["rests_on"]:
        listed = parts if len(parts) <= 4 else [*parts[:3], f"without {len(parts) - 3} others"]
        say(f"  It would be less probable than not {', or '.join(listed)}.")
    if (multiple := robust["budget_multiple_at_which_it_fails"]) and multiple > 1.0:
        say(f"  It is not sure with a budget {multiple:g} times as large.")


def _print_explanations(body: dict[str, Any]) -> None:
    rows = []
    for row in body["ranking"][:9]:
        first = row["parameters"][:3]
        values = ", ".join(with_unit(f"{p['name']} {p['value']:.3g}", p["unit"]) for p in first)
        more = f", and {len(row['parameters']) - 3} more" if len(row["parameters"]) > 3 else ""
        rmse = row["validation_rmse_N"]
        name = " + ".join(row["candidates"]) or ("something else" if row["effects"] else "nothing missing")
        if row["log_evidence_gain"] is None:
            continue
        rows.append([name, row["probability"], row["log_evidence_gain"], rmse["after"], values + more])
    table(
        "Explanations",
        ["what is missing", "probability", "ln evidence", "validation RMSE [N]", "value"],
        rows,
        f"{body['candidates_searched']} searched, fitted or by the linearised model; a value without a unit is a ratio",
    )
    included = [f"{name} {p:.2f}" for name, p in body["inclusion"].items() if p >= _TOLD][:6]
    if included:
        say(f"Acts by its name, whatever else does (probability): {', '.join(included)}")


def _suspect(row: dict[str, Any]) -> str:
    """Return a suspect load case with its probability and what its reading would be expected of."""
    like = [r["words"] for r in row["reads_like"][:2]]
    said = f"; reads like {' or '.join(like)}" if like else ""
    return f"{row['case']} ({row['probability']:.2f}{said})"


def _print_where(where: dict[str, Any]) -> None:
    rows = []
    for label, key in (("muscle", "by_muscle"), ("posture", "by_posture"), ("mount", "by_location")):
        worst = sorted(where[key].items(), key=lambda item: -(item[1]["z_rms"] or 0.0))[:3]
        rows += [[label, name, e["cases"], e["rmse_N"], e["z_rms"]] for name, e in worst]
    table(
        f"Where the model fails, after a refit with nothing added{_without(where)}",
        ["by", "", "cases", "RMSE [N]", "z"],
        rows,
        "z: norm of the residual in standard uncertainties, root mean square over cases",
    )


def _print_fall(body: dict[str, Any]) -> None:
    rows = []
    plane = body["judged_in"]
    for place, planes in body["before"].items():
        before, after = planes[plane]["rmse_N"], body["after"][place][plane]["rmse_N"]
        seen = "fitted" if place.startswith("identification") else "not fitted"
        rows.append([place, seen, before, after])
    table(f"RMSE [N] before and after{_without(body['where'])}", ["cases", "", "before", "after"], rows)


def _without(where: dict[str, Any]) -> str:
    """Say which cases stand apart, and do not count."""
    return f", without {', '.join(where['without'])}" if where["without"] else ""
