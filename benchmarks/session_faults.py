"""How often a fault of the whole session is named: labels, mounts, side, signs, units, axes, gain, tare.

    python -m benchmarks.session_faults [--each 4] [--mistyped] [--seed-from COMMIT] [--out FILE]

On sessions of the independent simulator, every second with an effect of the catalogue. Each fault is put into the
session's file or its recording, as a bench makes it. Named means that the first fault said is of its kind, with 0.5
or more, or that the session is refused with the reason. `--mistyped` puts a decimal point of one mass into the wrong
place besides. Seeds come from a commit's name. Writes
`benchmarks/session_faults.md`, and every session's outcome beside it as JSON lines.
"""

from __future__ import annotations

import datetime as dt
import json
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import commit, publish, sessions_parser
from benchmarks.random_worlds import base_seed
from benchmarks.recorded import Recorded
from benchmarks.recovery import rate_line
from daq.errors import InputError
from daq.vocabulary import OTHER_MOUNT
from tests.simulator import draw_session, draw_truth

Floats = NDArray[np.float64]
Rng = np.random.Generator
# Rows that are entered too high or too low: so many at least; fewer are cases that were exchanged.
_LONG = 5
# Cases of a posture and a mount that are entered alike: so many at least.
_SEVERAL = 3


def tendons(session: Recorded, rng: Rng) -> None:
    """Exchange two tendons throughout."""
    _exchange_tendons(session.document["cases"], rng)


def tendons_in_a_posture(session: Recorded, rng: Rng) -> None:
    """The same in all cases of one posture."""
    name = str(rng.choice(sorted(session.postures)))
    _exchange_tendons([c for c in session.document["cases"] if c["posture"] == name], rng)


def tendons_from_a_change_on(session: Recorded, rng: Rng) -> None:
    """The same from a change of posture or mount on: the cables were led anew."""
    cases = session.document["cases"]
    settings = [(c["posture"], c["location"]) for c in cases]
    changes = [k for k in range(1, len(cases)) if settings[k] != settings[k - 1]]
    # Enough cases that the rest is not a posture by itself.
    _exchange_tendons(cases[int(rng.choice([k for k in changes if k < 0.8 * len(cases)])) :], rng)


def _exchange_tendons(cases: list[dict[str, Any]], rng: Rng) -> None:
    hung = sorted({m for c in cases for m in c["masses_g"]})
    a, b = rng.choice(hung, 2, replace=False).tolist()
    other = {a: b, b: a}
    for case in cases:
        case["masses_g"] = {other.get(m, m): g for m, g in case["masses_g"].items()}


def postures(session: Recorded, rng: Rng) -> None:
    """Exchange two postures throughout."""
    a, b = rng.choice(sorted(session.postures), 2, replace=False).tolist()
    other = {a: b, b: a}
    for case in session.document["cases"]:
        case["posture"] = other.get(case["posture"], case["posture"])


def mount(session: Recorded, rng: Rng) -> None:
    """Enter the other mount for the cases of one posture at one of them."""
    fitted = [(c["posture"], c["location"]) for c in session.document["cases"] if c["role"] == "identification"]
    # Of fewer it is a slip of each.
    several = sorted(at for at, count in Counter(fitted).items() if count >= _SEVERAL)
    posture, place = several[int(rng.integers(len(several)))]
    for case in session.document["cases"]:
        if (case["posture"], case["location"]) == (posture, place):
            case["location"] = OTHER_MOUNT[place]


def mounts(session: Recorded, _: Rng) -> None:
    """Enter each mount for the other throughout."""
    for case in session.document["cases"]:
        case["location"] = OTHER_MOUNT[case["location"]]


def side(session: Recorded, _: Rng) -> None:
    """Enter the other hand: a cell along the mounts' axes on a right hand, read as one on a left hand."""
    mounts = session.document["load_cell"].setdefault("mounts", {})
    for place in ("tip", "bone"):
        mounts.setdefault(place, {})["rotation_deg"] = [0.0, 0.0, 0.0]
    session.document["specimen"]["side"] = "left"


def sign(session: Recorded, rng: Rng) -> None:
    """Enter one angle of one posture with the other sign."""
    _turn_one(session.postures, rng)


def unseen_sign(session: Recorded, rng: Rng) -> None:
    """The same in a posture of validation cases alone."""
    _turn_one(session.unseen_postures, rng)


def _turn_one(postures: dict[str, dict[str, float]], rng: Rng) -> None:
    bent = [(p, j) for p, angles in postures.items() for j, a in angles.items() if abs(a) >= 15.0]
    posture, joint = bent[int(rng.integers(len(bent)))]
    postures[posture][joint] *= -1.0


def sign_everywhere(session: Recorded, rng: Rng) -> None:
    """Enter one joint's angle with the other sign in all postures."""
    joint = str(rng.choice(["MCP", "PIP"]))
    for angles in session.document["postures_deg"].values():
        angles[joint] *= -1.0


def joints_in_a_posture(session: Recorded, rng: Rng) -> None:
    """Enter two angles of one posture in each other's place."""
    apart = [a for a in session.postures.values() if abs(a["PIP"] - a["DIP"]) >= 15.0]
    angles = apart[int(rng.integers(len(apart)))]
    angles["PIP"], angles["DIP"] = angles["DIP"], angles["PIP"]


def joints_everywhere(session: Recorded, _: Rng) -> None:
    """Enter two angles of every posture in each other's place."""
    for angles in session.document["postures_deg"].values():
        angles["PIP"], angles["DIP"] = angles["DIP"], angles["PIP"]


def mistyped_angle(session: Recorded, rng: Rng) -> None:
    """Enter one angle of one posture by 15 to 30 degrees more or less."""
    angles = session.postures[str(rng.choice(sorted(session.postures)))]
    angles[str(rng.choice(["MCP", "PIP"]))] += float(rng.choice([-1.0, 1.0]) * rng.uniform(15.0, 30.0))


def radians(session: Recorded, rng: Rng) -> None:
    """Enter the angles of one posture in radians."""
    _in_radians(session.postures, rng)


def unseen_radians(session: Recorded, rng: Rng) -> None:
    """The same in a posture of validation cases alone."""
    _in_radians(session.unseen_postures, rng)


def every_angle_in_radians(session: Recorded, _: Rng) -> None:
    """Enter the angles of all postures in radians."""
    for name in session.document["postures_deg"]:
        _turn_into_radians(session.document["postures_deg"], name)


def every_angle_negative(session: Recorded, _: Rng) -> None:
    """Enter all angles of all postures with the other sign, as where extension counts."""
    for angles in session.document["postures_deg"].values():
        angles.update({joint: -angle for joint, angle in angles.items()})


def _in_radians(postures: dict[str, dict[str, float]], rng: Rng) -> None:
    _turn_into_radians(postures, str(rng.choice(sorted(postures))))


def _turn_into_radians(postures: dict[str, dict[str, float]], name: str) -> None:
    postures[name].update({joint: float(np.deg2rad(angle)) for joint, angle in postures[name].items()})


def mass_unit(session: Recorded, rng: Rng) -> None:
    """Enter the masses in another unit."""
    grams = float(rng.choice([28.3495, 453.592, 101.972, 1000.0]))
    for case in session.document["cases"]:
        case["masses_g"] = {m: g / grams for m, g in case["masses_g"].items()}


def weights_of_a_tendon(session: Recorded, rng: Rng) -> None:
    """Enter half of what hung on one tendon throughout."""
    tendon = str(rng.choice(["FDP", "FDS", "EDC"]))
    for case in session.document["cases"]:
        case["masses_g"] = {m: 0.5 * g if m == tendon else g for m, g in case["masses_g"].items()}


def hanger_counted(session: Recorded, rng: Rng) -> None:
    """Count a hanger in every mass that did not hang."""
    grams = float(rng.uniform(10.0, 30.0))
    for case in session.document["cases"]:
        case["masses_g"] = {m: g + grams for m, g in case["masses_g"].items()}


def line_slips(session: Recorded, rng: Rng) -> None:
    """Let a tendon pull less than hangs on it, from one of its load cases on."""
    tendon = str(rng.choice(["FDP", "FDS"]))
    loaded = [case for case in session.document["cases"] if tendon in case["masses_g"]]
    fitted = [k for k, case in enumerate(loaded) if case["role"] == "identification"]
    # So many of the fitted ones before and after that neither are slips.
    first, left = int(rng.choice(fitted[_SEVERAL : 1 - _SEVERAL])), float(rng.uniform(0.5, 0.8))
    for case in loaded[first:]:
        case["masses_g"][tendon] /= left


def line_chafes(session: Recorded, rng: Rng) -> None:
    """Let a tendon pull less than hangs on it, in one posture."""
    loaded = [
        (m, c["posture"]) for c in session.document["cases"] if c["role"] == "identification" for m in c["masses_g"]
    ]
    # In fewer cases each is a slip.
    several = sorted(at for at, count in Counter(loaded).items() if count >= _SEVERAL)
    tendon, posture = several[int(rng.integers(len(several)))]
    left = float(rng.uniform(0.5, 0.8))
    for case in session.document["cases"]:
        if case["posture"] == posture and tendon in case["masses_g"]:
            case["masses_g"][tendon] /= left


def rows(session: Recorded, rng: Rng) -> None:
    """Enter the load of one case some rows too high or too low, so that each between is one row off."""
    stretches: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for case in session.document["cases"]:
        stretches.setdefault((case["posture"], case["location"]), []).append(case)
    long = [cases for cases in stretches.values() if len(cases) >= _LONG]
    cases = long[int(rng.integers(len(long)))]
    count = int(rng.integers(_LONG, len(cases) + 1))
    first, step = int(rng.integers(len(cases) - count + 1)), int(rng.choice([-1, 1]))
    run = cases[first : first + count]
    hung = [dict(case["masses_g"]) for case in run]
    for k, case in enumerate(run):
        case["masses_g"] = hung[(k - step) % count]


def moments_in_Nm(session: Recorded, _: Rng) -> None:  # noqa: N802 - the unit's name
    """Record moments in another unit than their columns say."""
    session.values[:, 3:] /= 1000.0


def forces_in_pounds(session: Recorded, _: Rng) -> None:
    """Record forces in pounds-force, and moments as their columns say."""
    session.values[:, :3] /= 4.4482


def axes(session: Recorded, rng: Rng) -> None:
    """Take x for y and so on, at both mounts."""
    order = [[1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]][int(rng.integers(5))]
    session.values = session.values[:, [*order, *(3 + k for k in order)]]


def every_sign(session: Recorded, _: Rng) -> None:
    """Take the force on the finger for that of the finger, at both mounts."""
    session.values = -session.values


def every_sign_at_the_tip(session: Recorded, _: Rng) -> None:
    """The same in a session that has read the tip alone."""
    session.document["cases"] = [c for c in session.document["cases"] if c["location"] == "tip"]
    session.values = -session.values


def gain(session: Recorded, rng: Rng) -> None:
    """Read the forces of one mount with a gain of 0.75 to 1.3."""
    gain_of(session, str(rng.choice(["tip", "bone"])), float(rng.choice([0.75, 0.85, 1.15, 1.3])))


def gain_of(session: Recorded, place: str, factor: float) -> None:
    """Read one mount with a gain."""
    for case in session.document["cases"]:
        if case["location"] == place:
            # About the unloaded reading: that is what a gain is seen by.
            zero = session.values[session.within(case, "unloaded_s")].mean(axis=0)
            loaded = session.within(case, "loaded_s")
            session.values[loaded] = zero + factor * (session.values[loaded] - zero)


def tare_twice(session: Recorded, rng: Rng) -> None:
    """Zero the cell before each weight, where the session's file takes the tare away again."""
    session.values[:, :3] += rng.normal(0.0, 1.5, 3)
    zero_before_each_weight(session)


def zero_before_each_weight(session: Recorded) -> None:
    """Take from what each case reads under load what it reads without."""
    for case in session.document["cases"]:
        zero = session.values[session.within(case, "unloaded_s")].mean(axis=0)
        session.values[session.within(case, "loaded_s")] -= zero


def weight_at_a_tare(session: Recorded, rng: Rng) -> None:
    """Leave a part of a load on one tendon hanging while the tare of its posture and mount is taken."""
    change, case = _part_of_a_load(session, rng)
    session.values[session.within(case, "unloaded_s")] += change


def weight_left_hanging(session: Recorded, rng: Rng) -> None:
    """Leave a part of a load on one tendon hanging, after the tare, in all cases of its posture and mount."""
    change, case = _part_of_a_load(session, rng)
    for other in session.document["cases"]:
        if other["unloaded_s"] == case["unloaded_s"]:
            session.values[session.within(other, "loaded_s")] += change


def old_tare(session: Recorded, rng: Rng) -> None:
    """Read the cases of one posture and mount with the tare of another time."""
    blocks = Counter(tuple(c["unloaded_s"]) for c in session.document["cases"] if c["role"] == "identification")
    # Of fewer each is a slip.
    several = sorted(tare for tare, count in blocks.items() if count >= _SEVERAL)
    tare = several[int(rng.integers(len(several)))]
    cases = [case for case in session.document["cases"] if tuple(case["unloaded_s"]) == tare]
    _move_zero(session, cases, rng)


def zero_moves(session: Recorded, rng: Rng) -> None:
    """Let the zero of the cell step, at one mount from one of its cases on."""
    place = str(rng.choice(["tip", "bone"]))
    cases = [case for case in session.document["cases"] if case["location"] == place]
    fitted = [k for k, case in enumerate(cases) if case["role"] == "identification"]
    _move_zero(session, cases[int(rng.choice(fitted[_SEVERAL : 1 - _SEVERAL])) :], rng)


def _move_zero(session: Recorded, cases: list[dict[str, Any]], rng: Rng) -> None:
    offset_N = rng.uniform(0.15, 0.6, 3) * rng.choice([-1.0, 1.0], 3)
    for case in cases:
        session.values[session.within(case, "loaded_s"), :3] += offset_N


def _part_of_a_load(session: Recorded, rng: Rng) -> tuple[Floats, dict[str, Any]]:
    """What a part of a load on one tendon changes (6,) [N, N mm], and the case that has the load."""
    cases = [c for c in session.document["cases"] if len(c["masses_g"]) == 1 and c["role"] == "identification"]
    case = cases[int(rng.integers(len(cases)))]
    loaded, tare = (session.values[session.within(case, window)].mean(axis=0) for window in ("loaded_s", "unloaded_s"))
    return float(rng.uniform(0.3, 1.0)) * (loaded - tare), case


Fault = Callable[[Recorded, Rng], None]
# With the kind that is to be said. A gain of both mounts is friction of the rig, and none of these.
FAULTS: dict[Fault, str] = {
    tendons: "tendon_labels",
    tendons_in_a_posture: "tendon_labels",
    tendons_from_a_change_on: "tendon_labels",
    postures: "posture",
    mount: "mount",
    mounts: "mount",
    side: "side",
    sign: "posture",
    sign_everywhere: "posture",
    joints_in_a_posture: "posture",
    joints_everywhere: "posture",
    mistyped_angle: "posture",
    radians: "posture",
    unseen_sign: "posture",
    unseen_radians: "posture",
    every_angle_in_radians: "posture",
    mass_unit: "mass_unit",
    weights_of_a_tendon: "weight",
    hanger_counted: "weight",
    rows: "rows",
    moments_in_Nm: "unit",
    axes: "axes",
    every_sign: "axes",
    every_sign_at_the_tip: "axes",
    gain: "gain",
    tare_twice: "tare",
    weight_at_a_tare: "tare_weight",
    weight_left_hanging: "weight",
    old_tare: "zero",
    zero_moves: "zero",
    line_slips: "tension",
    line_chafes: "tension",
    every_angle_negative: "posture",
    forces_in_pounds: "unit",
}


def mistype(session: Recorded, rng: Rng) -> None:
    """Put the decimal point of one mass of an identification case into the wrong place."""
    fitted = [c for c in session.document["cases"] if c["role"] == "identification" and c["masses_g"]]
    masses = fitted[int(rng.integers(len(fitted)))]["masses_g"]
    masses[min(masses)] *= 10.0 if rng.random() < 0.5 else 0.1


def one_session(seed: int, fault: Fault, acts: bool, mistyped: bool = False) -> dict[str, Any]:
    """Draw a session with a fault, diagnose it, and keep what was said."""
    from fingermodel import Session, diagnose

    effects = draw_truth("one", seed).effects if acts else {}
    with tempfile.TemporaryDirectory() as folder:
        draw_session(Path(folder), seed, effects, nuisance_scale=1.0)
        recorded = Recorded(Path(folder))
        rng = np.random.default_rng(seed)
        fault(recorded, rng)
        if mistyped:
            mistype(recorded, rng)
        recorded.write()
        began, refused = time.perf_counter(), None
        body: Mapping[str, Any] = {"session_faults": [], "verdict": "", "effects": []}
        try:
            body = diagnose(Session.open(folder)).answer
        except InputError as error:
            refused = str(error)
        seconds = time.perf_counter() - began
    faults = body["session_faults"]
    # Masses below a gram are refused by name; any other refusal is a fault of ours.
    named = fault is mass_unit if refused else bool(faults) and faults[0]["kind"] == FAULTS[fault]
    return {
        "seed": seed,
        "fault": fault.__name__,
        "effects": sorted({name.split(".")[0] for name in effects}),
        "named": named,
        "said": faults,
        "refused": refused,
        "verdict": body["verdict"],
        "found": body["effects"],
        "seconds": seconds,
    }


def report(rows: list[dict[str, Any]], given: str) -> list[str]:
    """Lines of the page."""
    of = {f: [r for r in rows if r["fault"] == f.__name__] for f in FAULTS}
    return [
        "# Faults of the whole session",
        "",
        f"`python -m benchmarks.session_faults {given}`, {dt.datetime.now(tz=dt.UTC).date()}, commit {commit()}; "
        f"{len(rows)} sessions, {np.median([r['seconds'] for r in rows]):.1f} s each (median, compiling included).",
        "",
        "| figure | rate | 95 % (Wilson) | count |",
        "|---|---|---|---|",
        rate_line("named, or refused with the reason", [r["named"] for r in rows]),
        *(rate_line(f"- {f.__name__.replace('_', ' ')}", [r["named"] for r in own]) for f, own in of.items()),
        rate_line("an effect is called found beside it", [bool(r["found"]) for r in rows]),
        "",
        "Not every sign or side moves the readings: an angle counts as far as tendons cross its joint, a side as far",
        "as forces leave the finger's plane.",
        "",
    ]


def main() -> None:
    parser = sessions_parser(__doc__, 4, "fault", __file__)
    parser.add_argument("--mistyped", action="store_true", help="one mass is mistyped besides")
    options = parser.parse_args()
    base, rows = base_seed(options.seed_from), []
    with options.out.with_suffix(".jsonl").open("w", encoding="utf-8") as kept:
        for number in range(options.each):
            for k, fault in enumerate(FAULTS):
                rows.append(one_session(base + 100 * number + k, fault, number % 2 == 1, options.mistyped))
                kept.write(json.dumps(rows[-1]) + "\n")
                kept.flush()
    given = f"--each {options.each}{' --mistyped' if options.mistyped else ''}"
    publish(options.out, report(rows, given))


if __name__ == "__main__":
    main()
