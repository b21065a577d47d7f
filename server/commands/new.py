"""`fingertwin new`: a session from a lab's recordings and notebook."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from server.commands.console import answer, progress, say, table

if TYPE_CHECKING:
    from daq.lab.drafts import Choice
    from daq.lab.files import LabFileMap
    from daq.lab.levels import Level
    from daq.lab.notebook import Note
    from daq.readings import ReadingBlock
    from daq.session_models import Session

READINGS, MAPPING, SESSION = "readings.parquet", "map.yaml", "session.yaml"
_HEADER = ("specimen", "finger", "tension_factor", "load_cell", "gravity_m_s2", "environment", "budget")
_SURE = 0.8
_REQUIRED = ("specimen", "finger", "tension_factor")


@dataclass(frozen=True)
class NewOptions:
    """What the command was given.

    Attributes:
        recordings: in the order in which they were made.
        out: folder of the session.
        notes: notebook; setup: bench-setup/1; like: an earlier session of the same rig; mapping: lab-file-map/1.
        postures: such as `hook: MCP 0 PIP 65 DIP 50`.
        yes: take all proposals, ask nothing.
    """

    recordings: tuple[Path, ...]
    out: Path
    notes: Path | None
    setup: Path | None
    like: Path | None
    mapping: Path | None
    postures: tuple[str, ...]
    yes: bool


def new_session(options: NewOptions, json: str | None) -> None:
    """Make a session.

    Raises:
        InputError: something cannot be read, or is not known and cannot be asked for.
    """
    from contextlib import ExitStack

    from daq.lab.drafts import cases_of, joined, still_missing
    from daq.lab.traces import as_recording
    from daq.sessions import parse_session

    if (options.out / SESSION).exists():
        raise InputError(f"{options.out.name} has a session already", "a new folder", "Choose another --out")
    asking = not options.yes and json != "-" and sys.stdin.isatty() and sys.stdout.isatty()
    header = _header(options, asking)
    with ExitStack() as held:
        recordings = [held.enter_context(as_recording(path)) for path in options.recordings]
        mapping = _mapping(options, recordings, asking)
        with progress("Reading"):
            blocks, told = joined(recordings, mapping)
    told += [f"taken as proposed: {doubt}" for doubt in (mapping.doubts if mapping and options.yes else ())]
    told.append("masses in the notebook are grams where it states no unit")
    notes = _notes(options, header["finger"], asking)
    if not asking:  # what will be missing is said before the work is done
        _postures(options, [n.posture for n in notes if n.kind == "load"], asking)
    levels, choices, lost = _laid(blocks, notes)
    if json != "-":
        _show(levels, choices)
        for line in lost:
            say(f"  {line}")
    if asking:
        choices = _asked(choices, header["finger"])
    cases = cases_of(levels, choices)
    document = header | {"format": "bench-session/1", "id": options.out.resolve().name, "readings": READINGS}
    document |= {"postures_deg": _postures(options, [c["posture"] for c in cases], asking), "cases": cases}
    names = [path.name for path in options.recordings]
    document["provenance"] = {"made_by": "fingertwin new", "recordings": names}
    session, faults = parse_session(document, None, SESSION)
    if session is None:
        raise faults[0]
    _write(options.out, session, blocks, mapping)
    _report(options, document, choices, [*told, *lost], still_missing(document), json)


def _laid(blocks: Sequence[ReadingBlock], notes: Sequence[Note]) -> tuple[Sequence[Level], list[Choice], list[str]]:
    """Plateaus, what they are taken for, and the lines of the notebook that were found on none."""
    import numpy as np

    from daq.lab.drafts import chosen
    from daq.lab.layout import lay
    from daq.lab.levels import find_levels

    with progress("Laying the notebook onto the plateaus"):
        levels = find_levels(np.concatenate([b.t_s for b in blocks]), np.concatenate([b.wrench for b in blocks]))
        if not levels:
            raise InputError(
                "the recording holds still nowhere for a second", "plateaus", "Look: fingertwin plot RECORDING"
            )
        layout = lay(levels, notes)
    lost = [f"line {notes[i].line} was found on no plateau: {_said(notes[i])}" for i in layout.not_found]
    return levels, chosen(layout, notes), lost


def _write(out: Path, session: Session, blocks: Sequence[ReadingBlock], mapping: LabFileMap | None) -> None:
    from daq.lab.files import write_mapping
    from daq.readings import write_readings
    from daq.sessions import write_session
    from server.application.exporting import writing

    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        write_readings(out / READINGS, blocks)
        if mapping is not None:
            write_mapping(out / MAPPING, mapping)
        write_session(session, out)


def _report(
    options: NewOptions,
    document: Mapping[str, Any],
    choices: Sequence[Choice],
    notes: Sequence[str],
    missing: Sequence[str],
    json: str | None,
) -> None:
    from daq.checks import check

    found = check(options.out)
    unsure = sum(c.sure < _SURE for c in choices)
    warnings = [f"{f.level}: {f.where}: {f.text}" for f in found.findings if f.level != "note"]
    body: dict[str, Any] = {"session": str(options.out), "cases": len(document["cases"]), "plateaus": len(choices)}
    body |= {"unsure": unsure, "sound": found.ok, "check": warnings, "notes": list(notes), "missing": list(missing)}
    if answer("new", body, json):
        return
    for line in (*notes, *warnings):
        say(f"  {line}")
    for line in missing:
        say(f"  missing for a diagnosis: {line}")
    said = f", {unsure} of {len(choices)} plateaus to look at" if unsure else ""
    say(f"{len(document['cases'])} load cases{said}: {options.out}   (fingertwin check {options.out})")


def _header(options: NewOptions, asking: bool) -> dict[str, Any]:
    """Specimen, finger, cell and friction: of an earlier session, of a setup, or asked for."""
    from daq.sessions import plain_document, read_session, read_yaml

    out: dict[str, Any] = {}
    if options.like is not None:
        out |= {k: v for k, v in plain_document(read_session(options.like)).items() if k in _HEADER}
    if options.setup is not None:
        given = read_yaml(options.setup)
        if not isinstance(given, Mapping) or given.get("format") != "bench-setup/1":
            raise InputError(f"{options.setup.name} is not a setup", "format: bench-setup/1")
        out |= {k: v for k, v in given.items() if k in _HEADER}
    lacks = [key for key in _REQUIRED if key not in out]
    if lacks and not asking:
        raise InputError(
            f"{', '.join(lacks)} not known",
            "what no recording tells",
            "Give --setup FILE (bench-setup/1), or --like an earlier session of the rig",
        )
    if asking:
        out |= _ask_header([*lacks, *([] if "load_cell" in out else ["load_cell"])])
    return out


def _ask_header(lacks: Sequence[str]) -> dict[str, Any]:
    from rich.prompt import FloatPrompt, Prompt

    from fingermodel.finger_files import finger_names

    out: dict[str, Any] = {}
    if "specimen" in lacks:
        name = Prompt.ask("Specimen, a pseudonym")
        species, digit = Prompt.ask("Species", default="human"), Prompt.ask("Digit", default="third")
        side = Prompt.ask("Side of the hand", choices=["left", "right"])
        out["specimen"] = {"id": name, "species": species, "digit": digit, "side": side}
    if "finger" in lacks:
        out["finger"] = Prompt.ask(f"Finger: a file, or one of {', '.join(finger_names())}", default="an1979_middle")
    if "tension_factor" in lacks:
        said = Prompt.ask("Friction: a factor, or 'estimate' by force balance", default="estimate")
        out["tension_factor"] = {"estimate": "force_balance"} if said == "estimate" else float(said)
    if "load_cell" in lacks:
        model = Prompt.ask("Model of the load cell, such as ATI Nano17-E SI-25-0.25", default="")
        rate = FloatPrompt.ask("Sampling rate [Hz], 0 if not known", default=0.0)
        tip = Prompt.ask("Axes of readings at the tip: the bone's name", default="distal_phalanx")
        bone = Prompt.ask("Axes of readings at the bone: the bone's name", default="metacarpal")
        cell = {"model": model or None, "rate_hz": rate or None}
        mounts = {"tip": {"frame": tip}, "bone": {"frame": bone}}
        out["load_cell"] = {k: v for k, v in cell.items() if v} | {"mounts": mounts}
    return out


def _mapping(options: NewOptions, recordings: Sequence[Path], asking: bool) -> LabFileMap | None:
    """Which channel is which, confirmed; None where every recording is a readings file."""
    from daq.lab.drafts import is_readings_file
    from daq.lab.files import read_mapping
    from daq.lab.proposals import propose_mapping
    from server.commands.lab_files import show_proposal

    first = next((path for path in recordings if not is_readings_file(path)), None)
    if first is None:
        return None
    beside = [options.mapping, options.like / MAPPING if options.like else None]
    beside += [options.recordings[0].with_name(f"{options.recordings[0].name}.map.yaml")]
    known = next((path for path in beside if path is not None and (path.is_file() or path is options.mapping)), None)
    if known is not None:
        return read_mapping(known)
    proposal = propose_mapping(first)
    if asking:
        from rich.prompt import Confirm, Prompt

        show_proposal(first.name, proposal)
        channels = {
            key: taken if taken.unit else taken.model_copy(update={"unit": Prompt.ask(f"Unit of {taken.channel}")})
            for key, taken in proposal.channels.items()
        }
        proposal = proposal.model_copy(update={"channels": channels})
        if not Confirm.ask("Is that right?", default=False):
            raise InputError("the mapping was not confirmed", "a mapping", "Make one: fingertwin import RECORDING")
    elif not options.yes:
        raise InputError("which channel is which was not confirmed", "--map FILE, or --yes to take the proposal")
    return proposal.model_copy(update={"confirmed": True})


def _notes(options: NewOptions, finger: str, asking: bool) -> tuple[Note, ...]:
    from daq.lab.notebook import read_notes
    from daq.vocabulary import did_you_mean
    from fingermodel.finger_files import read_finger

    tendons = read_finger(finger, options.setup.parent if options.setup else None).topology.muscles
    if options.notes is not None:
        try:
            text = sys.stdin.read() if str(options.notes) == "-" else options.notes.read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{options.notes} cannot be read ({error})", "a notebook as text or CSV") from error
    elif asking:
        say(
            "What hung, line by line, such as 'FDP 950, hook, tip'; masses in g; 'tare' where you noted one; "
            "an empty line ends"
        )
        lines = []
        while line := input("  ").strip():
            lines.append(line)
        text = "\n".join(lines)
    else:
        raise InputError("no notebook", "--notes FILE with lines such as 'FDP 950, hook, tip'")
    notes = read_notes(text, tendons)
    for note in notes:
        for name, _ in note.masses_g:
            if name not in tendons:
                hint = did_you_mean(name, tendons)
                raise InputError(f"line {note.line} of the notebook names {name!r}", f"of {' '.join(tendons)}", hint)
    return notes


def _said(note: Note | None) -> str:
    if note is None:
        return ""
    masses = " + ".join(f"{name} {mass:g} g" for name, mass in note.masses_g)
    return f"{masses}, {note.posture}, {note.location}" + (", validation" if note.role == "validation" else "")


def _show(levels: Sequence[Level], choices: Sequence[Choice]) -> None:
    import numpy as np

    rows, tare = [], None
    for i, (level, choice) in enumerate(zip(levels, choices, strict=True), 1):
        if choice.kind == "tare":
            tare = level.plateau.mean
        change = (
            "" if tare is None or choice.kind != "load" else f"{np.linalg.norm((level.plateau.mean - tare)[:3]):.2f}"
        )
        what = _said(choice.note) or choice.kind
        sure = f"{choice.sure:.2f}" + ("" if choice.sure >= _SURE else " look")
        rows.append([str(i), f"{level.window_s[0]:g} to {level.window_s[1]:g}", change, what, sure])
    table("Plateaus", ["", "window [s]", "change [N]", "taken for", "sure"], rows)


def _asked(choices: list[Choice], finger: str) -> list[Choice]:
    """Let somebody change lines of the table until nothing more is to be changed."""
    from rich.prompt import Prompt

    from daq.lab.notebook import read_notes
    from fingermodel.finger_files import read_finger

    tendons = read_finger(finger).topology.muscles
    while line := Prompt.ask(
        "Change one, such as '7 tare', '7 skip' or '7 FDP 300, hook, tip'; Enter takes all", default=""
    ):
        match = re.match(r"\s*(\d+)\s+(.*)", line)
        if match is None or not 1 <= int(match[1]) <= len(choices):
            say(f"  a number from 1 to {len(choices)}, and what it is")
            continue
        at, what = int(match[1]) - 1, match[2].strip()
        if what in ("tare", "skip"):
            choices[at] = replace(choices[at], kind=what, note=None, sure=1.0)
            continue
        try:
            (note, *_) = read_notes(what, tendons)
        except InputError as error:
            say(f"  {error}")
            continue
        choices[at] = replace(choices[at], kind="load", note=note, sure=1.0)
    return choices


def _postures(options: NewOptions, wanted: Sequence[str], asking: bool) -> dict[str, dict[str, float]]:
    """Angles of postures [deg]."""
    from daq.lab.drafts import posture_of
    from daq.sessions import plain_document, read_session

    known: dict[str, dict[str, float]] = {}
    if options.like is not None:
        known |= plain_document(read_session(options.like)).get("postures_deg", {})
    known |= dict(posture_of(text) for text in options.postures)
    names = list(dict.fromkeys(wanted))
    lacks = [name for name in names if name not in known]
    if lacks and not asking:
        raise InputError(
            f"the angles of {', '.join(lacks)} are not known",
            f"--posture '{lacks[0]}: MCP 0 PIP 65 DIP 50' for each, in degrees, flexion positive",
        )
    for name in lacks:
        known[name] = posture_of(f"{name}: {input(f'Angles of {name} [deg], such as MCP 0 PIP 65 DIP 50: ')}")[1]
    return {name: known[name] for name in names}
