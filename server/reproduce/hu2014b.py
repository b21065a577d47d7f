"""Hu, Ren, Howard, Zong 2014 (BioMed Res Int 743460): the extensor hood as a network of springs, in three postures.

The paper prints neither where its nodes lie, nor its stiffnesses, nor the bones. Stiffnesses follow from its own tables
(force over length change); the nodes are laid out by An et al. 1979 and by choice, each with its note in
`data/hoods/hu2014b_index.yaml`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from fingermodel.compiled.compilation import prepare_jax
from fingermodel.inverse.pressing import pressing_forces
from fingermodel.studies.published import Row, not_available, row
from server.reproduce.hu2014a import PUSH
from server.reproduce.hu2014a_fingers import index_finger
from server.reproduce.hu2014b_network import (
    Held,
    contact_of,
    held_by,
    hood_of,
    index_with_network,
    printed_loads,
    pulls_by_components,
    pulls_by_table_1,
)
from server.reproduce.hu2014b_plots import plots
from server.reproduce.hu2014b_sheets import layouts_sheet, nodes_sheet, pulls_sheet, springs_sheet, stiffness_sheet
from server.reproduce.hu2014b_specimens import against_rhombus
from server.reproduce.printed import reference
from server.reproduce.study import Progress, Reproduction

JOINTS = ("DIP", "PIP", "MCP")
ALLOWED = (
    "agrees: within what half a digit of Table 1's muscle forces (0.05 P in each) moves our number; the digits of the "
    "tables are finer than those of their input"
)
SLACK = "slack in print: agrees where ours is slack, and carries exactly 0 N"
MISPRINT = "misprint: force over length change is one number a component, but for this one; mended in the next row"
PLACED = ("GB", "MB")
GIVEN = "given: that it is slack in print told where G and M lie"
ANATOMY = (
    "by Eqs 7 and 8 with An's second digit; the paper's moment arms are not printed (see hu2014a, where one millimetre "
    "of the terminal slip decides)"
)
CONTACT = (
    "muscle forces as printed, slips from our network, FDP from the load's moment about the DIP with An's moment arms; "
    "contact grows with FDP, so with that one arm"
)
SUMS = "printed forces of the springs at the muscle's node, against the muscle's own printed force"


def reproduce(progress: Progress) -> Reproduction:
    """Settle the hood in the three postures, and refit it to the published specimens beside Winslow's rhombus."""
    prepare_jax()
    finger = index_with_network()
    loads = printed_loads()
    held = held_by(finger, loads, [pulls_by_table_1(load) for load in loads])
    progress(0.2)
    hood = hood_of(finger)
    springs = hood.network.springs
    rows = [*_sum_rows(loads), *_muscle_rows(loads), *_contact_rows(loads, contact_of(finger, loads, held))]
    for k, one in enumerate(held):
        rows += _component_rows(k + 1, one, springs)
    rows += _text_rows(held, springs)
    sheets = [pulls_sheet(loads), nodes_sheet(held, hood), springs_sheet(held, springs)]
    sheets += [stiffness_sheet(hood), layouts_sheet(loads)]
    progress(0.4)
    specimens, fits = against_rhombus(lambda done: progress(0.4 + 0.6 * done))
    return Reproduction(
        rows=tuple(rows),
        assumptions=tuple(reference("hu2014b")["assumptions"]),
        sheets=(*sheets, specimens),
        results={"springs": list(springs), "specimens": fits},
        plots=lambda: plots(held),
    )


def _sum_rows(loads: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Set Table 1 against Tables 2 and 3: whether the paper's own forces meet at its nodes."""
    for k, load in enumerate(loads, 1):
        size = sum(x * x for x in load["force_N"]) ** 0.5
        sums = pulls_by_components(load)
        for m in ("RI", "LU", "UI"):
            name = f"posture {k}, {m}: sum of its springs' printed forces"
            yield row(name, load["printed"][m], sums[m] / size, "P", SUMS)


def _muscle_rows(loads: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield Table 1's muscle forces from Eqs 7 and 8 with An's index finger."""
    finger = index_finger(reference("hu2014a"))
    for k, load in enumerate(loads, 1):
        muscle = pressing_forces(finger, load["theta_deg"], load["force_N"], "chao").muscle
        for m in ("RI", "LU", "UI"):
            note = f"{PUSH}; {ANATOMY}" if muscle[m] < 0.0 else ANATOMY
            yield row(f"posture {k}, {m}: muscle force by Eqs 7 and 8", load["printed"][m], muscle[m], "P", note)


def _contact_rows(loads: Sequence[dict[str, Any]], contact: Sequence[dict[str, float]]) -> list[Row]:
    return [
        row(f"posture {k + 1}, {joint}: contact force", load["printed"][joint], one[joint], "P", CONTACT)
        for k, (load, one) in enumerate(zip(loads, contact, strict=True))
        for joint in JOINTS
    ]


def _component_rows(number: int, held: Held, springs: Sequence[str]) -> Iterator[Row]:
    """Yield the length change and force of every spring, as printed and, where that is a misprint, as mended."""
    tables = reference("hu2014b")
    for i, spring in enumerate(springs):
        length, force = tables["components"][held.name][spring]
        mend = tables["misprints"].get(held.name, {}).get(spring, {})
        slack = float(held.force_N[i]) == 0.0
        for what, unit, printed, ours, allowed in (
            ("length change", "mm", length, float(held.change_mm[i]), float(held.change_within_mm[i])),
            ("force", "N", force, float(held.force_N[i]), float(held.force_within_N[i])),
        ):
            name, likely = f"posture {number}, {spring}: {what}", mend.get(f"{what.split()[0]}_{unit}", printed)
            if likely != printed:
                yield not_available(name, printed, ours, unit, MISPRINT)
                name += ", mended"
            near = _near(ours, likely, allowed)
            if force != "0":
                yield Row(name, float(likely), ours, unit, near, ALLOWED, likely)
            elif what == "force" and spring in PLACED:
                yield not_available(name, printed, ours, unit, GIVEN)
            else:
                agrees = slack and (what == "force" or near)
                yield Row(name, float(likely), ours, unit, agrees, SLACK, likely)


def _text_rows(held: Sequence[Held], springs: Sequence[str]) -> list[Row]:
    """Return rows on the text's statements about the tables."""
    index = {s: i for i, s in enumerate(springs)}
    most_force = sum(int(h.force_N.argmax()) == index["CD"] for h in held)
    most_change = sum(int(h.change_mm.argmax()) == index["MN"] for h in held)
    smaller = sum(max(h.force_N[index[s]] for s in ("FA", "LA", "FG", "LM")) < 0.5 * h.force_N.max() for h in held)
    less = "'smaller forces' is taken as less than half of the largest"
    return [
        row("postures in which CD carries most", "3", float(most_force), "of 3"),
        row("postures in which MN lengthens most", "3", float(most_change), "of 3"),
        row("postures in which FA, LA, FG and LM carry less", "3", float(smaller), "of 3", less),
    ]


def _near(ours: float, printed: str, allowed: float) -> bool:
    return abs(ours - float(printed)) <= allowed + 0.5 * 10.0 ** -len(printed.partition(".")[2])
