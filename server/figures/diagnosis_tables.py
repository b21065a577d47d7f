"""The tables of a diagnosis: suspects, where it fails, explanations, values, nulls, errors, hints, next load cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fingermodel.fitting.reading_errors import OTHER_SCATTER
from fingermodel.parameters import with_unit
from server.figures.diagnosis_answer import (
    Answer,
    after_which_fit,
    change_text,
    effect_name,
    explanation_name,
    from_to,
    gains_of,
    locations_in_order,
    masses_of,
    named_rows,
    part,
    plane_of,
    probability_text,
    ranked,
    rows,
    shown,
    signed,
    text,
    value,
    with_sd,
    words,
)
from server.figures.diagnosis_held_out import held_out
from server.figures.diagnosis_ranking import shown_rows
from server.figures.diagnosis_revisions import steps_of
from server.figures.report import Table
from server.figures.style import PLANE_NAMES, fixed, load_text, number, other_plane

_GROUPS = {
    "by_location": "mount",
    "by_muscle": "loaded tendon",
    "by_posture": "posture",
    "by_load_level": "load level",
    "by_component": "component",
}
_NULLS = {"holds": "holds", "violated": "violated", "not_tested": "not tested"}
_MOST_VALUES = 5  # explanations whose values are told


def suspects_table(answer: Answer) -> list[Table]:
    """Tabulate the suspect load cases, the likeliest first, with what would make each expected."""
    lines = []
    for row in rows(answer, "suspects"):
        without = part(row, "verdict_without")
        kind = text(without, "verdict").replace("_", " ")
        names = ", ".join(effect_name(e) for e in words(without.get("effects")))
        p = probability_text(without.get("probability"))
        instead = f"{kind}{f': {names}' if names else ''} ({p})" if kind else "–"
        like = "; ".join(str(r.get("words")) for r in rows(row, "reads_like") if r.get("words")) or "–"
        lines.append([text(row, "case", "–"), probability_text(row.get("probability")), like, instead])
    header = ["load case", "probability that it is bad", "reads like", "verdict without it"]
    return [Table(header, lines, "Load cases that are not as the others make them expected.")] if lines else []


# Units of an answer's keys, as tables have them.
_SIGNS = {"pct": "%", "deg": "°", "mm": "mm", "mN": "mN"}


def rig_table(answer: Answer) -> list[Table]:
    """Tabulate what the readings say of the rig against what is stated: repeatability, budget, noise."""
    keys = ("repeatability", "budget_multiple", "anatomy_multiple", "noise_multiple", "extra_noise_N")
    repeat, budget, anatomy, noise, extra = (part(answer, k) for k in keys)
    carried = ", ".join(words(budget.get("carried_by")))
    stated = value(repeat.get("stated_pct"))
    lines = [
        ["repeatability of the tensions [%]", *_both(repeat, "_pct"), fixed(stated, 1) if stated else "none", ""],
        *[
            [f"{of.title} [{_SIGNS[of.unit]}]", *_both(repeat, f"_{of.unit}", of=of.key), "none", ""]
            for of in OTHER_SCATTER.values()
        ],
        ["multiple of the budget", *_both(budget), "1", f"bent most: {carried}" if carried else ""],
        ["multiple of the anatomy's spread", *_both(anatomy), "1", ""],
        ["multiple of the assumed noise", *_both(noise if noise.get("assumed") is True else {}), "1", ""],
        ["noise beside the measured one [N]", *_both(extra, digits=3), "0", ""],
    ]
    lines = [line for line in lines if line[1] != "–"]
    header = ["of the rig", "by the readings", "sd", "stated", "remarks"]
    return [Table(header, lines, "What the readings say of the rig, whatever effect acts.")] if lines else []


def _both(found: Answer, unit: str = "", digits: int = 2, of: str = "") -> tuple[str, str]:
    """Write a value and its standard deviation with so many decimals; both may be as good as nothing."""
    v, sd = value(found.get(f"{of or 'value'}{unit}")), value(found.get(f"{of and f'{of}_'}sd{unit}"))
    return "–" if v is None else fixed(v, digits), "–" if sd is None else fixed(sd, digits)


def where_table(answer: Answer) -> list[Table]:
    """Tabulate the residual by mount, tendon, posture, load level and component, the worst of each first."""
    out = []
    for key, name in _GROUPS.items():
        found = [(str(k), part(v)) for k, v in part(answer, "where", key).items()]
        found.sort(key=lambda item: -(value(item[1].get("z_rms")) or 0.0))
        out += [[f"{name}: {k}", shown(v, "cases", 0), shown(v, "rmse_N", 3), shown(v, "z_rms", 1)] for k, v in found]
    caption = (
        f"{after_which_fit(answer).capitalize()}, the worst first. z: norm of the residual in standard uncertainties, "
        "root mean square over cases; of one component that component alone."
    )
    return [Table(["cases", "n", "RMSE [N]", "z"], out, caption)] if out else []


def bent_table(answer: Answer) -> list[Table]:
    """Tabulate the rig's errors that a fit takes to be far beyond what is stated, and what would settle each."""
    fits = [part(answer, key) for key in ("where", "where_after")]
    fits = fits[:1] if words(fits[0].get("added")) == words(fits[1].get("added")) else fits
    found = [{str(row.get("name")): row for row in rows(fit, "bent")} for fit in fits]
    lines = []
    for name in dict.fromkeys(n for rows_ in found for n in rows_):
        one = next(rows_[name] for rows_ in found if name in rows_)
        unit = text(one, "unit")
        said = [_bent(rows_.get(name, {}), unit) for rows_ in found]
        lines.append([name, with_unit(shown(one, "stated_sd", 3), unit), *said, text(one, "remedy")])
    fit_names = [after_which_fit({"where": fit}) for fit in fits]
    header = ["error of the rig", "stated sd", *fit_names, "what would settle it"]
    caption = (
        "Errors of the rig that a refit takes to be more than two stated standard deviations, the most bent first."
    )
    return [Table(header, lines, caption)] if lines else []


def _bent(row: Answer, unit: str) -> str:
    widths = value(row.get("widths"))
    return (
        "within 2 sd" if widths is None else f"{with_unit(shown(row, 'value', 3), unit)} ({fixed(abs(widths), 0)} sd)"
    )


def torque_table(answer: Answer) -> list[Table]:
    """Tabulate the missing torque by joint."""
    found = [(str(k), part(v)) for k, v in part(answer, "where", "joint_torque_Nmm").items()]
    lines = [[k, shown(v, "rms"), shown(v, "sd")] for k, v in found]
    header = ["joint", "missing torque, RMS [N mm]", "sd [N mm]"]
    return [Table(header, lines, "Missing joint torque over all cases.")] if lines else []


def ranking_table(answer: Answer) -> list[Table]:
    """Tabulate the explanations that are drawn, with what they gain and what they are easily taken for."""
    named, out = named_rows(answer), []
    for place, row in enumerate(shown_rows(answer), start=1):
        remarks = ["named by the verdict"] if row in named else []
        remarks += ["value outside its range"] if row.get("in_range") is False else []
        remarks += [said for said in words(row.get("variant")) if ": " in said]
        if alike := words(row.get("indistinguishable_from")):
            remarks.append(f"not told apart from {', '.join(effect_name(n) for n in alike)}")
        evidence, held, size = gains_of(row)
        name, p = explanation_name(row), probability_text(row.get("probability"))
        out.append([str(place), name, p, evidence, size, held, "; ".join(remarks)])
    header = ["", "explanation", "probability", "ln evidence", "size [N] (95 %)"]
    header += ["validation RMSE [N], before → after", "remarks"]
    more = len(ranked(answer)) - len(out)
    caption = "Explanations, most probable first" + (f"; {more} less probable ones are left out." if more > 0 else ".")
    return [Table(header, out, caption)] if out else []


def parameter_table(answer: Answer) -> list[Table]:
    """Tabulate the fitted values of the explanations that the verdict names and of the most probable ones."""
    chosen = [r for r in ranked(answer) if rows(r, "parameters")]
    named = [r for r in named_rows(answer) if r in chosen]
    chosen = [*named, *[r for r in chosen if r not in named][: max(_MOST_VALUES - len(named), 0)]]
    out = []
    for row in chosen:
        name = explanation_name(row)
        for parameter in rows(row, "parameters"):
            found, sd = with_sd(parameter.get("value"), parameter.get("sd"))
            out.append([name, text(parameter, "name"), found, sd, text(parameter, "unit", "1")])
            name = ""
    header = ["explanation", "parameter", "value", "sd", "unit"]
    caption = "Values with their standard deviations, budget and effect fitted together."
    return [Table(header, out, caption)] if out else []


def inclusion_table(answer: Answer) -> list[Table]:
    """Tabulate the effects one by one: how probable in any explanation, and how well the data show it."""
    inclusion, detectability = part(answer, "inclusion"), part(answer, "detectability")
    names = [str(n) for n in dict.fromkeys([*inclusion, *detectability])]
    names.sort(key=lambda n: (-(value(inclusion.get(n)) or 0.0), -(value(detectability.get(n)) or 0.0)))
    lines = [[effect_name(n), probability_text(inclusion.get(n)), shown(detectability, n, 1)] for n in names]
    header = ["effect", "acts by its name", "detectability d"]
    caption = (
        "Probability that each effect acts by its name, whatever else does; d is its typical size against noise and "
        "budget (below 2 unseen)."
    )
    return [Table(header, lines, caption)] if lines else []


def nulls_table(answer: Answer) -> list[Table]:
    """Tabulate the tests that need no model."""
    lines = []
    for null in rows(answer, "nulls"):
        name, outcome = text(null, "name").replace(" ", "_"), text(null, "verdict")
        lines.append([effect_name(name), _NULLS.get(outcome, outcome), text(null, "text")])
    return [Table(["test", "outcome", "what was found"], lines)] if lines else []


def error_table(answer: Answer) -> list[Table]:
    """Tabulate the errors before and after by role and mount, as a comparison does."""
    before, after = part(answer, "before"), part(answer, "after")
    keys = [str(k) for k in dict.fromkeys([*before, *after])]
    places, plane = locations_in_order(k.partition("/")[2] for k in keys), plane_of(answer)
    other = other_plane(plane)
    keys.sort(key=lambda k: (k.partition("/")[0], places.index(k.partition("/")[2])))

    def both(key: str, plane: str, name: str, digits: int) -> str:
        return from_to(part(before, key, plane).get(name), part(after, key, plane).get(name), digits)

    lines = [
        [
            key.replace("/", ", "),
            number(value(part(before, key, "space").get("cases", part(after, key, "space").get("cases"))), 0),
            both(key, plane, "rmse_N", 3),
            both(key, plane, "rmse_rel_pct", 1),
            both(key, plane, "magnitude_error_N", 3),
            both(key, plane, "direction_error_deg", 1),
            both(key, other, "rmse_N", 3),
        ]
        for key in keys
    ]
    header = ["cases", "n", "RMSE [N]", "RMSE [%]", "magnitude [N]", "direction [°]", f"RMSE {PLANE_NAMES[other]} [N]"]
    caption = f"Errors before → after, {PLANE_NAMES[plane]} unless said otherwise. Validation cases are never fitted."
    caption += " Suspect cases are left out." if rows(answer, "suspects") else ""
    return [Table(header, lines, caption)] if lines else []


def revision_table(answer: Answer, history: Sequence[Mapping[str, Any]] | None) -> list[Table]:
    """Tabulate the error at every revision, where there is a history."""
    steps = steps_of(answer, history) if history else []
    keys = list(dict.fromkeys(k for s in steps for k in s.rmse_N))
    lines = [[", ".join(s.lines), *(number(s.rmse_N.get(k), 3) for k in keys)] for s in steps]
    header = ["revision", *(k.replace("/", ", ") + " [N]" for k in keys)]
    return [Table(header, lines, "RMSE at every revision of the model, oldest first.")] if lines else []


def held_out_table(answer: Answer) -> list[Table]:
    """Tabulate the residual of every validation case before and after."""
    lines = [
        [h.label, number(h.before_N, 3), number(h.after_N, 3), change_text(h.before_N, h.after_N), number(h.sd_N, 3)]
        for h in held_out(answer)
    ]
    header = ["validation case", "before [N]", "after [N]", "change [N]", "uncertainty [N]"]
    caption = "Norm of predicted − measured of every validation case, and of the measurement's standard uncertainty."
    return [Table(header, lines, caption)] if lines else []


def hints_table(answer: Answer) -> list[Table]:
    """Tabulate the formulas that would reduce the residual."""
    lines = []
    for hint in rows(answer, "hints"):
        acts_on = ", ".join(str(w) for w in (hint.get("stage"), hint.get("joint")) if w)
        gains = [signed(hint.get(key)) for key in ("log_evidence_gain", "left_out_gain")]
        lines.append([text(hint, "formula", "–"), acts_on, *gains, text(hint, "text")])
    header = ["formula", "acts on", "ln evidence", "left-out gain", "in words"]
    caption = "Left-out gain: log density that the formula adds to the cases, each predicted from all others [nat]."
    return [Table(header, lines, caption)] if lines else []


def ready_made_table(answer: Answer) -> list[Table]:
    """Tabulate what rigs are known to do beyond the catalogue, where these readings show it."""
    lines = [
        [text(k, "effect", "–"), shown(k, "probability"), signed(k.get("log_evidence_gain")), text(k, "text")]
        for k in rows(answer, "ready_made")
    ]
    return [Table(["ready-made effect", "probability", "ln evidence", "in words"], lines)] if lines else []


def next_cases_table(answer: Answer) -> list[Table]:
    """Tabulate the load cases that would tell most."""
    lines = []
    for case in rows(answer, "next_cases"):
        hung = load_text(masses_of(case)).replace(" ", "\N{NO-BREAK SPACE}") if "masses_g" in case else "–"
        parted = " / ".join(effect_name(n) for n in words(case.get("separates")))
        place = [text(case, "posture", "–"), text(case, "location", "–")]
        lines.append([*place, hung, shown(case, "information_nat"), parted, text(case, "text")])
    header = ["posture", "at", "load", "information [nat]", "separates", "in words"]
    return [Table(header, lines, "Most telling first.")] if lines else []
