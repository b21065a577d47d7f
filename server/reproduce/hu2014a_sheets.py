"""Tables beside the rows of hu2014a: what fitted fingers give, and why the normative one gives other forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from fingermodel.inverse.pressing import pressing_forces, pressing_posture
from fingermodel.scaling import match_moment_arms
from server.reproduce.hu2014a_fingers import COLUMNS, MODELS, Pressed, means, moments, needed_arms, pressed
from server.reproduce.study import Line, Sheet

if TYPE_CHECKING:
    from fingermodel.fingers import Finger

PUSHED = "asked to push"
# Moment arms of the terminal slip about the DIP [mm] to try; the first is An's.
TERMINAL_MM = (1.84, 2.5, 3.5, 4.0, 4.5, 5.0, 6.0)


def forces_sheet(title: str, answers: Sequence[Pressed], published: dict[str, Any], notes: Sequence[str]) -> Sheet:
    """Return forces of both models at each load, and what the hood changes, beside the printed means."""
    lines: list[Line] = []
    for p in answers:
        printed = {model: means(published, model, p.postures) for model in MODELS}
        for model, label in MODELS.items():
            lines.append((p.title, label, "ours", *(p.forces[model][c] for c in COLUMNS), _pushed(p, model)))
            lines.append((p.title, label, "printed mean", *(printed[model][c] for c in COLUMNS), None))
        lines.append((p.title, "change [%]", "ours", *(p.change_pct(c) for c in COLUMNS), None))
        changes = (100.0 * (printed["chao"][c] / printed["minimal"][c] - 1.0) for c in COLUMNS)
        lines.append((p.title, "change [%]", "of printed means", *changes, None))
    return Sheet(title, ("posture", "model", "", *COLUMNS, PUSHED), lines, notes)


def _pushed(answer: Pressed, model: str) -> str:
    return ", ".join(answer.push[model]) or "none"


def needed_sheet(finger: Finger, published: dict[str, Any]) -> Sheet:
    """Return flexor moment arms that the printed forces need, beside the normative ones."""
    lines: list[Line] = []
    for load in published["loads"]:
        postures = tuple(load["postures"])
        arms, demand, size = moments(finger, load)
        needed = needed_arms(finger, load, means(published, "minimal", postures))
        divisor = arms["DIP", "FDP"] * arms["PIP", "ES"] - arms["PIP", "FDP"] * arms["DIP", "TE"]
        pairs = (x for joint in ("DIP", "PIP") for x in (demand[joint] / size, needed[joint], arms[joint, "FDP"]))
        lines.append((" and ".join(map(str, postures)), *pairs, divisor))
    return Sheet(
        "Why An's index does not give the printed forces: flexor moment arms that they need",
        (
            "posture",
            *(
                f"{what} [mm]"
                for j in ("DIP", "PIP")
                for what in (f"load at {j}", f"FDP at {j}, needed", f"FDP at {j}, An")
            ),
            "divisor [mm2]",
        ),
        lines,
        (
            "Needed: with the printed means of PF and PE without a hood, and our extensor's arms. Ketchum et al. 1978 "
            "measured 6.5 mm at the DIP and 9.8 mm at the PIP (as a handbook quotes them).",
            "Divisor: PF and PE of the minimal model are divided by (PF at PIP)(PE at DIP) - (PF at DIP)(PE at PIP). "
            "Where it is negative, these loads need extensors that push.",
        ),
    )


def terminal_sheet(finger: Finger, published: dict[str, Any]) -> Sheet:
    """Tabulate the influence of the terminal slip's moment arm at the DIP on both models."""
    posture = pressing_posture(finger.topology, published["loads"][0]["theta_deg"])
    lines: list[Line] = []
    for arm in TERMINAL_MM:
        answers = pressed(match_moment_arms(finger, {"DIP.TE": -arm}, [posture]), published)
        for p in answers:
            for model, label in MODELS.items():
                lines.append((arm, p.title, label, *(p.forces[model][c] for c in COLUMNS), _pushed(p, model)))
    return Sheet(
        "An's index with other terminal slips: moment arm at the DIP in posture 1, and the forces",
        ("TE at DIP [mm]", "posture", "model", *COLUMNS, PUSHED),
        lines,
        (
            "An's second digit has 1.84 mm, An's third digit at this size 3.6 mm. Near 3 mm the minimal model's "
            "divisor is zero; from 4 mm on every force as the study prints it (RI with LU) pulls, and contact at the "
            "MCP grows with flexion as the study says. RI alone is asked to push until 6 mm.",
            "So the forces of both closures hang on a millimetre or two that the study does not print.",
        ),
    )


def sister_sheet(fingers: Mapping[str, Sequence[Pressed]], published: dict[str, Any]) -> Sheet:
    """Return the full model at the loads of Hu et al. 2014b beside its own Table 1."""
    lines: list[Line] = []
    columns = ("radial", "ulnar", "DIP", "PIP", "MCP")
    for k, load in enumerate(published["loads"]):
        printed = {key: float(value) for key, value in load["printed"].items()}
        printed["radial"], printed["ulnar"] = printed["RI"] + printed["LU"], printed["UI"]
        lines.append((load["name"], "printed", *(printed[c] for c in columns)))
        lines += [
            (load["name"], who, *(answers[k].forces["chao"][c] for c in columns)) for who, answers in fingers.items()
        ]
    return Sheet(
        "The same loads in Hu et al. 2014b (Table 1, with a hood), per newton of load",
        ("load", "", *columns),
        lines,
        (
            "Contact forces of the same subject are printed as 8.0 to 14.6 there (DIP, PIP), and as 7.7 to 9.8 in the "
            "study itself.",
        ),
    )


def least_sheet(finger: Finger, published: dict[str, Any]) -> Sheet:
    """Tabulate our own answer: the same loads without sharing laws, muscles that pull."""
    muscles = finger.topology.muscles
    joints = [joint.name for joint in finger.topology.joints]
    lines: list[Line] = []
    for load in published["loads"]:
        answer = pressing_forces(finger, load["theta_deg"], load["force_N"], "least_squares")
        lines.append((load["name"], *(answer.muscle[m] for m in muscles), *(answer.contact[j] for j in joints)))
    return Sheet(
        "An's index with FDP and FDS apart and no sharing laws: least sum of squared stresses, per newton of load",
        ("load", *muscles, *(f"{joint} contact" for joint in joints)),
        lines,
        ("Every muscle pulls: the loads are within the finger's reach, though not under the study's two closures.",),
    )
