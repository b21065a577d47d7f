"""First and last page of a report: what to do, the finger with the effect, what it rests on, what words mean."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from daq.quoting import quoted
from fingermodel.diagnosis.verdict.instruments import rig_remedy
from fingermodel.parameters import with_unit
from server.figures.diagnosis_answer import Answer, effect_name, named_rows, part, rows, text, value, with_sd, words
from server.figures.plot import Plot
from server.figures.report import Section, Table
from server.figures.style import fixed

# Widths from which an error of the rig is worth a measurement of its own.
_FAR = 4.0
GLOSSARY = (
    ("identification case", "a load case that a refit may use"),
    ("validation case", "a load case that no refit ever uses; its error is the test"),
    ("residual", "measured less predicted force"),
    ("RMSE", "root mean square of the residual's force components [N]; in % of the mean measured force (Eqs 6 and 7)"),
    (
        "z",
        "norm of a residual in standard uncertainties of the reading; noise alone gives 1.4 in the plane, 1.7 in space",
    ),
    ("refit", "the model's parameters, chosen so that it explains the identification cases best"),
    ("effect", "a physical law that the model lacks, such as an unweighed hanger"),
    ("budget", "the errors that every rig has, with their stated standard deviations (sd)"),
    ("friction factor c", "tension in the tendon, as a part of the hung weight"),
    ("probability", "of a statement, given these readings, the model and its priors"),
    ("ln evidence", "natural logarithm of how much more probable the readings are than with nothing added"),
    ("detectability d", "typical size of an effect against noise and budget; below 2 it cannot be seen"),
    ("suspect", "a load case that is more probably bad than not; it counts for nothing in the verdict"),
)


def to_do(answer: Answer) -> list[str]:
    """Say what is to be done, in order, from the verdict, the suspects and the rig's errors."""
    from fingermodel.effects.catalogue import remedy

    verdict, session = str(answer.get("verdict")), str(answer.get("session") or "SESSION")
    faults = [f for f in rows(answer, "session_faults") if (value(f.get("probability")) or 0.0) >= 0.5]
    out = [
        f"Put the session right first: {fault.get('words')}."
        + (f" To be sure, {fault['settled_by']}." if fault.get("settled_by") else "")
        for fault in faults
    ]
    for suspect in rows(answer, "suspects"):
        like = next((str(r.get("words")) for r in rows(suspect, "reads_like") if r.get("words")), "")
        look = f"it reads like this: {like}. Amend it" if like else "nothing known explains it. Read its notes"
        out.append(f"Look at load case {suspect.get('case') or '?'}: {look}, or leave it out, and search again.")
    if missed := words(part(answer, "predictive_check").get("missed_after"))[:3]:
        out.append(
            f"Measure {' and '.join(missed)} again. If the reading comes again, fit cases like it: something acts "
            "there that no fitted case shows."
        )
    names = words(answer.get("candidates")) or words(answer.get("effects"))
    told = dict.fromkeys(found for n in names if (found := remedy(n)) is not None)
    if verdict in ("found", "one_of"):
        said = f" (the readings say {_values(answer)})" if verdict == "found" else ""
        out += [f"{what[0].upper()}{what[1:]}{said}." for what in told]
    held = words(answer.get("held"))
    lacking = [n for n in names if not any(p == n or p.startswith(f"{n}.") for p in held)]
    if verdict == "found" and lacking:
        out.append(f"Put it into the model: fingertwin add {' '.join(map(quoted, [*lacking, session]))}.")
    # What makes up for a fault of the session is settled by none of these.
    bent = () if faults else rows(answer, "where_after" if "where_after" in answer else "where", "bent")
    for row in bent:
        widths, what = abs(value(row.get("widths")) or 0.0), rig_remedy(str(row.get("name")))
        if widths >= _FAR and what not in told:
            told[what] = None
            far = f"the refit takes {row.get('name')} to be {fixed(widths, 0)} stated standard deviations off"
            out.append(f"{what[0].upper()}{what[1:]}: {far}.")
    cases = rows(answer, "next_cases")
    if cases and verdict != "nothing_missing" and not faults:
        why = "to confirm it" if verdict == "found" else "to tell the explanations apart"
        if said := str(cases[0].get("text") or "").rstrip("."):
            out.append(f"Measure this load case next, {why}: {said}.")
    return out or ["Nothing: no measurement and no change of the model is asked for."]


def _values(answer: Answer) -> str:
    told = []
    for row in named_rows(answer):
        for parameter in rows(row, "parameters")[:3]:
            found, sd = with_sd(parameter.get("value"), parameter.get("sd"))
            told.append(with_unit(f"{parameter.get('name')} = {found} ± {sd}", text(parameter, "unit", "1")))
    return ", ".join(told)


def read_first(lines: Sequence[str]) -> list[Section]:
    """Return what has to be known before a result as the first part of a report, where there is anything."""
    return [Section("Before you read on", lines)] if lines else []


def finger_section(answer: Answer, finger: Plot | None) -> list[Section]:
    """Return the finger with the effect as a part of the first page, where there is one."""
    added = " and ".join(effect_name(n) for n in words(part(answer, "where_after").get("added")))
    return [] if finger is None else [Section(f"The finger with {added}", [finger])]


def closing_sections(origin: Mapping[str, object]) -> list[Section]:
    """Return what a report rests on, as far as it is known, and what its words mean."""
    lines = [[key.replace("_", " "), str(text)] for key, text in origin.items() if text is not None]
    rests = [Section("What this rests on", [Table(["", ""], lines)], folded=True)] if lines else []
    return [*rests, Section("Glossary", [Table(["word", "what it means here"], GLOSSARY)], folded=True)]


def folded(sections: Iterable[Section]) -> list[Section]:
    """Return sections that a click opens."""
    return [Section(s.heading, s.parts, folded=True) for s in sections]
