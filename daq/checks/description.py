"""Look at what a session describes: unknown keys, masses, loads beyond the protocol, what the plan leaves open."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from daq.errors import InputError
from daq.findings import Finding, finding
from daq.locations import data_dir
from daq.sessions import FINGER_DOCUMENT, finger_file
from daq.sessions.models import LoadCase, Open, Session
from daq.sessions.protocols import protocol_names, read_protocol
from daq.vocabulary import JOINT_ANGLES, did_you_mean

# Weights of 5 % of the maximum muscle force (Synek et al. 2019, Table 1; two sutures of a muscle together).
PUBLISHED_G: Mapping[str, Mapping[str, float]] = {
    "human": {"RI": 650.0, "LU": 45.0, "UI": 500.0, "FDP": 950.0, "FDS": 950.0, "EDC": 400.0},
    "bonobo": {"RI": 550.0, "LU": 40.0, "UI": 400.0, "FDP": 650.0, "FDS": 800.0, "EDC": 250.0},
}
MOST_LOAD = 1.5
# Five percent of a lumbrical is less than a suture carries easily; only above this is a small muscle's load remarked.
LEAST_LIMIT_G = 250.0
FRAMES = {"tip": "distal_phalanx", "bone": "metacarpal"}


def session_findings(session: Session) -> list[Finding]:
    """List what is doubtful in a session's description, without its readings."""
    return [
        *_unknown_keys(session),
        *_finger(session),
        *_postures(session),
        *_angle_units(session),
        *_frames(session),
        *_mass_units(session),
        *_loads(session),
        *_cases(session),
        *_plan(session),
    ]


def case_name(case: LoadCase) -> str:
    """Return a case's name in findings."""
    return f"case {case.id}"


def _unknown_keys(session: Session) -> Iterator[Finding]:
    records: list[tuple[str, Open | None]] = [("session", session), ("load_cell", session.load_cell)]
    records += [(case_name(c), c) for c in session.cases]
    records += [(f"events[{i}]", e) for i, e in enumerate(session.events)]
    records += [("environment", session.environment)]
    for where, record in records:
        if record is None:
            continue
        for key, hint in record.unknown_keys().items():
            if record is session and key == FINGER_DOCUMENT and _brings_finger(session):
                continue
            yield finding(
                "warning",
                "unknown_key",
                where,
                f"unknown key {key!r}, which changes nothing",
                "keys of bench-session/1",
                hint or "Remove it, or put it into a note",
            )


def _finger(session: Session) -> Iterator[Finding]:
    shipped = sorted(p.stem for p in (data_dir() / "fingers").glob("*.yaml"))
    found = session.finger in shipped or finger_file(session.finger, session.folder) or _brings_finger(session)
    if not found:
        hint = did_you_mean(session.finger, shipped)
        yield finding(
            "error",
            "unknown_finger",
            "finger",
            f"no parameter set {session.finger!r}",
            f"one of {' '.join(shipped)}, or a path",
            hint,
        )


def _brings_finger(session: Session) -> bool:
    """Return whether a document that lies in no folder, as a service keeps it, brings its finger along."""
    return session.folder is None and FINGER_DOCUMENT in session.unknown_keys()


def _postures(session: Session) -> Iterator[Finding]:
    for name, posture in session.postures_deg.items():
        for joint in posture.model_extra or {}:
            yield finding(
                "note",
                "other_joint",
                f"postures_deg.{name}.{joint}",
                f"an angle that is none of {' '.join(JOINT_ANGLES)}; only a finger with this joint can use it",
            )
    used = {c.posture for c in session.cases if c.excluded is None}
    if len(used) == 1:
        yield finding(
            "warning",
            "single_posture",
            "cases",
            f"all cases are in one posture, {next(iter(used))}",
            "two or more",
            "Effects of joint angles cannot be told from effects of tension: measure another posture",
        )
    for name in session.postures_deg:
        if name not in used:
            yield finding("note", "unused_posture", f"postures_deg.{name}", "no case uses this posture")


def _angle_units(session: Session) -> Iterator[Finding]:
    """Yield a finding where no angle is larger than a half turn is in radians; straight fingers alone are no sign."""
    angles = [abs(angle) for posture in session.postures_deg.values() for angle in posture.model_dump().values()]
    if 0.0 < max(angles, default=0.0) < math.pi:
        yield finding(
            "warning",
            "angle_units",
            "postures_deg",
            "all angles are below 3.2°; are they radians?",
            "degrees",
            "Multiply by 57.3 if they are radians",
        )


def _frames(session: Session) -> Iterator[Finding]:
    for name, mount in (session.load_cell.mounts if session.load_cell else {}).items():
        if mount.frame is not None and mount.frame != FRAMES[name]:
            yield finding(
                "warning",
                "frame",
                f"load_cell.mounts.{name}.frame",
                f"{mount.frame!r}",
                f"{FRAMES[name]}, whose axes readings at {name} are taken to be in",
                "Correct it, or give the rotation to those axes",
            )


def _mass_units(session: Session) -> Iterator[Finding]:
    """Yield a finding where masses in g below 15 must be kg or newtons, save those of a lumbrical."""
    small = [
        (case_name(case), tendon, mass)
        for case in session.cases
        for tendon, mass in case.masses_g.items()
        if 0.0 < mass < (2.0 if tendon == "LU" else 15.0)
    ]
    if small:
        where, tendon, mass = small[0]
        unit = "kg" if mass < 2.0 else "N"
        more = f" (and {len(small) - 1} more)" if len(small) > 1 else ""
        yield finding(
            "warning",
            "mass_units",
            f"{where}: masses_g.{tendon}",
            f"{mass:g} g{more}; that looks like {unit}",
            "grams",
            "Multiply by 1000" if unit == "kg" else "Divide by gravity and multiply by 1000",
        )


def _loads(session: Session) -> Iterator[Finding]:
    try:
        limits, why = _limits_g(session)
    except InputError as error:
        yield finding("warning", "unknown_protocol", "protocol", error.found, error.expected, error.remedy)
        return
    for case in session.cases:
        for tendon, mass in case.masses_g.items():
            limit = limits.get(tendon, 0.0)
            if mass > limit * (1.0 + 1e-6):
                remedy = "Is it in mg?" if mass > 2e4 else "Sutures rupture: check the mass, or exclude the case"
                where = f"{case_name(case)}: masses_g.{tendon}"
                yield finding(
                    "warning", "load_beyond_protocol", where, f"{mass:g} g", f"at most {limit:g} g {why}", remedy
                )


def _limits_g(session: Session) -> tuple[dict[str, float], str]:
    """Return the most that may hang on each tendon: of the protocol that the session names, or of the published one."""
    # A session without a folder may come from anywhere: a name of it is no path then.
    if session.protocol is not None and (session.folder is not None or session.protocol in protocol_names()):
        protocol = read_protocol(session.protocol, session.folder)
        return protocol.heaviest_g(), f"(protocol {protocol.id})"
    published = PUBLISHED_G.get(session.specimen.species.lower(), PUBLISHED_G["human"])
    limits = {tendon: max(MOST_LOAD * mass, LEAST_LIMIT_G) for tendon, mass in published.items()}
    return limits, f"({MOST_LOAD:g} times the published 5 % of maximum force, or {LEAST_LIMIT_G:g} g)"


def _cases(session: Session) -> Iterator[Finding]:
    for case in session.cases:
        where = case_name(case)
        if not sum(case.masses_g.values()):
            yield finding("note", "no_weight", where, "no weight hangs on any tendon")
        ignored = [k for k in ("force_sd_N", "force_cov_N2", "torque_Nmm") if getattr(case, k) is not None]
        if case.recorded and ignored:
            yield finding(
                "warning",
                "ignored_key",
                f"{where}: {ignored[0]}",
                "stated beside windows, so it is not used",
                "the uncertainty and torque of the recording",
                "Remove it",
            )
        if case.excluded is not None:
            yield finding("note", "excluded", where, f"left out: {case.excluded}")
        weight_N = sum(case.masses_g.values()) * 1e-3 * session.gravity_m_s2
        force = sum(f * f for f in case.force_N or ()) ** 0.5
        if beyond_weights(force, weight_N):
            yield finding(
                "warning",
                "force_units",
                f"{where}: force_N",
                f"{force:.3g} N for {weight_N:.3g} N of weights",
                "a force of about the weights or less",
                "Is it in other units, or are the masses wrong?",
            )


def beyond_weights(force_N: float, weight_N: float) -> bool:
    """Whether a force is more than its weights can make, a hanger and an offset of the zero allowed for."""
    # The bone carries the weights themselves, and friction takes from them.
    return 0.0 < weight_N < (force_N - 0.5) / 1.5


def _plan(session: Session) -> Iterator[Finding]:
    kept = [c for c in session.cases if c.excluded is None]
    roles = {c.role for c in kept}
    if "validation" not in roles:
        yield finding(
            "note", "no_validation", "cases", "no validation case, so no finding can be supported by unseen loads"
        )
    if "identification" not in roles:
        yield finding(
            "warning", "no_identification", "cases", "no identification case", "cases to fit", "Give some that role"
        )
    if not any(c.location == "bone" for c in kept):
        yield finding("note", "no_bone", "cases", "no case at the bone, so tensions cannot be balanced")
    if session.readings is not None and not any(c.recorded for c in session.cases) and not session.checks:
        yield finding("note", "unused_readings", "readings", "no case has a window in the readings")
    if not 9.76 <= session.gravity_m_s2 <= 9.84:
        yield finding(
            "warning",
            "gravity",
            "gravity_m_s2",
            f"{session.gravity_m_s2:g} m/s²",
            "9.76 to 9.84 on the surface of the Earth",
        )
