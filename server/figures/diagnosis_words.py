"""A diagnosis in plain sentences: the verdict, its sensitivity, what cannot be told apart, and how it was found."""

from __future__ import annotations

from collections.abc import Sequence

from server.figures.diagnosis_answer import (
    CONFOUNDED,
    DETECTABLE,
    Answer,
    effect_name,
    explanation_name,
    named_rows,
    part,
    probability_text,
    rows,
    signed,
    value,
    vector,
    words,
)
from server.figures.diagnosis_confounding import classes_of
from server.figures.diagnosis_sensitivity import verdict_under
from server.figures.style import number

VERDICTS = {
    "found": "found",
    "one_of": "one of several",
    "none_of_catalogue": "none of the catalogue",
    "nothing_missing": "nothing missing",
    "undecided": "undecided",
}


def title(answer: Answer) -> str:
    """Name the page by the sessions that were diagnosed."""
    ids = words(answer.get("sessions")) or words(answer.get("session"))
    shown = ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
    return f"Diagnosis of {shown}" if shown else "Diagnosis"


def listed(names: Sequence[str], last: str = "and") -> str:
    """Write `a, b and c`."""
    return f"{', '.join(names[:-1])} {last} {names[-1]}" if len(names) > 1 else "".join(names)


def verdict_sentences(answer: Answer) -> list[str]:
    """Say the verdict first, then how sure it is and why."""
    out = [_sentence(answer), _status(answer)]
    if of := words(answer.get("probability_of")):
        out.append(f"Probability of what: {of[0]}.")
    return [*out, *_first_suspects(answer), *words(answer.get("reasons")), *words(answer.get("notes"))]


def misfit_sentences(answer: Answer) -> list[str]:
    """Say how far the model without any effect is from the readings, and how many explanations were searched."""
    out = []
    chi = part(answer, "chi_square")
    if (found := value(chi.get("value"))) is not None:
        said = f"χ² of the model without any effect, with the budget as stated: {number(found, 1)}"
        if (freedom := value(chi.get("degrees_of_freedom"))) is not None:
            said += f" at {freedom:g} degrees of freedom"
        if value(chi.get("p_value")) is not None:
            said += f" (p {_equals(chi.get('p_value'))})"
        after = value(chi.get("after"))
        if after is None or after == found:
            counted = "Scatter and noise are taken as large as this model needs to explain the readings."
        else:
            said += f"; {number(after, 1)} with the best explanation"
            counted = "Scatter and noise are taken as large as the best explanation needs."
        out += [f"{said}.", counted]
    return [*out, *_search(answer)]


def _equals(p: object) -> str:
    text = probability_text(p)
    return f"{text[0]} {text[1:]}" if text[0] in "<>" else f"= {text}"


def _sentence(answer: Answer) -> str:
    if own := words(answer.get("sentence")):
        return own[0]
    named = [effect_name(e) for e in words(answer.get("candidates")) or words(answer.get("effects"))]
    said = {
        "found": f"Missing in the model: {listed(named)}.",
        "one_of": f"One of these is missing, and these load cases cannot say which: {listed(named, 'or')}.",
        "none_of_catalogue": "Something is missing that no effect of the catalogue explains.",
        "nothing_missing": "Nothing is missing: the model explains the readings within their uncertainty.",
    }
    return said.get(str(answer.get("verdict")), "Undecided: the readings do not settle what is missing.")


def _status(answer: Answer) -> str:
    verdict = str(answer.get("verdict", "undecided"))
    said = f"Verdict: {VERDICTS.get(verdict, verdict)}"
    if value(answer.get("probability")) is not None:
        said += f", probability {probability_text(answer.get('probability'))}"
    if verdict not in ("found", "one_of"):
        return said + "."
    confirmed = answer.get("confirmed")
    if confirmed is None:
        return said + (
            ". Not confirmed yet: that takes a load case of a new mounting or session, measured after its prediction "
            "was frozen."
        )
    if confirmed is False:
        return said + ". Not confirmed: a load case measured after its prediction was frozen did not agree."
    named = f" by {confirmed}" if isinstance(confirmed, str) else ""
    return said + f". Confirmed{named}: a load case measured after its prediction was frozen agreed."


def _search(answer: Answer) -> list[str]:
    searched = value(answer.get("candidates_searched"))
    if searched is None:
        return []
    return [f"{searched:g} explanation{'' if searched == 1 else 's'} searched, fitted or by the linearised model."]


def _first_suspects(answer: Answer) -> list[str]:
    """Name the suspect cases in one sentence."""
    found = [
        f"{row.get('case') or '?'} (probability {probability_text(row.get('probability'))})"
        for row in rows(answer, "suspects")
    ]
    many = "s" if len(found) > 1 else ""
    return [f"Suspect load case{many}: {listed(found)}."] if found else []


def suspect_sentences(answer: Answer) -> list[str]:
    """Say whether any load case is suspect, and what a suspect one counts for."""
    if not rows(answer, "suspects"):
        return (
            ["No load case is suspect: each is as the others make it expected."]
            if "suspects" in answer
            else ["Whether a load case is suspect was not worked out."]
        )
    return ["A suspect case counts for nothing in the verdict. Look at its masses, tendons and posture."]


def fault_sentences(answer: Answer) -> list[str]:
    """Say what may be wrong with the labels of the whole session."""
    return [
        f"The whole session: {row.get('words') or row.get('kind') or '?'} "
        f"(probability {probability_text(row.get('probability'))})."
        for row in rows(answer, "session_faults")
    ]


def beyond_sentences(answer: Answer) -> list[str]:
    """Say how likely something acts that no effect describes, alone or beside what is named."""
    beyond = part(answer, "beyond")
    if (p := value(beyond.get("probability"))) is None:
        return []
    said = f"Something that no effect describes acts, alone or beside others: probability {probability_text(p)}"
    size = value(beyond.get("amplitude_N"))
    alone = [(str(name), p) for name, share in part(beyond, "of_one_alone").items() if (p := value(share)) is not None]
    of = f", in {alone[0][0]} alone with a probability of {probability_text(alone[0][1])}" if alone else ""
    return [said + (f"; if so, about {number(size)} N{of}." if size else ".")]


def curve_sentences(answer: Answer) -> list[str]:
    """Say where a misfit lives that nothing in the catalogue explains."""
    said = part(answer, "curve").get("sentence")
    return [str(said)] if said else []


def predictive_sentences(answer: Answer) -> list[str]:
    """Say how the validation cases are predicted, before and after."""
    check = part(answer, "predictive_check")
    before, after = value(check.get("p_value_before")), value(check.get("p_value_after"))
    if before is None and after is None:
        return []
    said = (
        f"Predictive check on the validation cases: p {_equals(before)} without any effect, p {_equals(after)} with "
        "what the verdict would add."
    )
    gains = [value(check.get(f"log_density_{k}")) for k in ("before", "after")]
    if gains[0] is not None and gains[1] is not None:
        said += f" Their log density changes by {signed(gains[1] - gains[0])}."
    return [said]


def robustness_sentences(answer: Answer) -> list[str]:
    """Say under which assumptions the verdict is no longer probable."""
    robust = part(answer, "robustness")
    if not robust:
        return ["Not tried: no assumption was varied."]
    sure, tried = verdict_under(answer)
    out = [f"Of {tried} other assumptions, {sure} leave the verdict sure (probability 0.9 or more)."] if tried else []
    if flips := words(robust.get("flips_when")):
        out.append(f"It would be less probable than not if {'; or if '.join(flips)}.")
    elif "flips_when" in robust:
        out.append("Under none of them is it less probable than not.")
    if rests := words(robust.get("rests_on")):
        out.append(f"It would be less probable than not: {'; '.join(rests)}.")
    if (multiple := value(robust.get("budget_multiple_at_which_it_fails"))) and multiple > 1.0:
        out.append(
            f"It is no longer sure once the rig's own errors (the budget) are {number(multiple, 1)} times as large."
        )
    if alone := words(robust.get("sagittal_alone")):
        names = listed([VERDICTS.get(a, effect_name(a)) for a in alone[0].split(" and ")])
        out.append(f"With the forces in the sagittal plane alone: {names}.")
    return out or ["Not tried: no assumption was varied."]


def confounding_sentences(answer: Answer) -> list[str]:
    """Say which effects are one class, and which the data cannot show at all."""
    out = []
    for one in classes_of(answer):
        names = listed([effect_name(n) for n in one])
        out.append(f"One class, not to be told apart by these load cases: {names}.")
    if not out:
        out.append(
            f"No two effects leave traces that are alike (largest canonical correlation {CONFOUNDED} and above)."
            if part(answer, "confounding")
            else "Which effects can be told apart was not worked out."
        )
    weak = [
        effect_name(str(k))
        for k, v in part(answer, "detectability").items()
        if (d := value(v)) is not None and d < DETECTABLE
    ]
    if weak:
        out.append(f"These data cannot show (detectability below {DETECTABLE:g}): {listed(weak)}.")
    for row in named_rows(answer):
        if (alike := words(row.get("indistinguishable_from"))) and answer.get("verdict") == "found":
            names = listed([effect_name(n) for n in alike])
            out.append(f"{explanation_name(row).capitalize()} leaves nearly the same trace as {names}.")
    return out


def torque_sentences(answer: Answer) -> list[str]:
    """Say what the missing torques are, and what they cannot tell, where there are any."""
    if not part(answer, "where", "joint_torque_Nmm") and not rows(answer, "where", "joint_torque_cases"):
        return []
    said = (
        "The residual forces, taken back through the Jacobian into joint torques: what the readings ask for beyond the "
        "model. Without a measured Mz they are known only up to one amount common to DIP, PIP and MCP, which their "
        "standard deviations contain."
    )
    clear = [
        str(joint)
        for joint, found in part(answer, "where", "joint_torque_Nmm").items()
        if (r := value(part(found).get("rms"))) is not None
        and (s := value(part(found).get("sd"))) is not None
        and r > 2 * s > 0
    ]
    return [said + (f" Clearly missing at {listed(clear)}." if clear else "")]


def counts(answer: Answer) -> str:
    """Say how many load cases there were, and where."""
    cases = rows(answer, "cases")
    if not cases:
        return ""
    held = sum(c.get("role") == "validation" for c in cases)
    at = [(w, sum(c.get("location") == w for c in cases)) for w in ("tip", "bone")]
    where = listed([f"{n} at the {w}" for w, n in at if n])
    none = sum(vector(c.get("measured_N")) is None for c in cases)
    said = f"{len(cases)} load case{'' if len(cases) == 1 else 's'}, {where or 'mount unknown'}; {held} for validation."
    return said + (f" {none} without a measured force." if none else "")


METHOD = (
    "One model of the session is fitted with every explanation: none, one, two or three effects. Tendon points, "
    "tension factor, cell and clamp vary within the errors of the rig, the budget. Without it a refit would hide the "
    "effect or invent one.",
    "Beside any explanation something smooth may act that no effect describes. So may scatter of the tensions from "
    "case to case, an error of each effect's form, and single bad cases. How large budget and noise are is left open.",
    "Each explanation is fitted, and linearised there: a Laplace approximation, which rewards fit and charges for "
    "freedom. Half of the prior probability is on no effect. What is said is read off the posterior of all together.",
    "Acts by its name means: the error of the effect's form is at most a tenth, and nothing unknown beside it is "
    "larger. Found needs a probability of 0.9 that it does, nothing missing one of 0.8.",
    "Validation cases are never fitted. They enter once, as a predictive check, which may veto a verdict. The "
    "sensitivity analysis conditions nothing.",
    "The ln evidence (natural logarithm) is against nothing missing: +3 multiplies an explanation's odds by "
    "about twenty, +5 by about 150. Size is the root mean square change of the fitted readings that the effect makes.",
)
