"""`fingertwin new`: a session from a lab's recordings and notebook."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.prompt import Prompt

from daq.checks import check
from daq.checks.description import FRAMES
from daq.errors import InputError
from daq.files import read_text
from daq.lab.drafts import Choice, cases_of, is_readings_file, joined, still_missing
from daq.lab.files import LabFileMap, read_mapping
from daq.lab.levels import Level
from daq.lab.notebook import Note
from daq.lab.proposals import OF_THE_FILE, grounds, propose_mapping
from daq.lab.traces import as_recording
from daq.quoting import quoted
from daq.sessions import finger_file, plain_document, read_session, read_yaml
from daq.vocabulary import LARGEST_FACTOR
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.session import Session
from server.application.exporting import writing
from server.application.new_session import (
    MAPPING,
    MASSES_IN_GRAMS,
    REQUIRED,
    SESSION,
    SURE,
    LaidNotes,
    Suspect,
    document_of,
    header_of,
    lacking,
    lay_notes,
    levels_of,
    notes_of,
    said,
    session_of,
    suspects,
    write_new,
)
from server.commands.console import answer, at_terminal, progress, say, table
from server.commands.mapping_dialogue import settled
from server.commands.questions import ask, ask_finger, ask_postures, lines, number, postures_of


@dataclass(frozen=True)
class NewOptions:
    """Arguments of the command."""

    recordings: tuple[Path, ...]  # in the order in which they were made
    out: Path  # folder of the session
    # Notebook; setup: bench-setup/1; like: an earlier session of the same rig; mapping: lab-file-map/1.
    notes: Path | None
    setup: Path | None
    like: Path | None
    mapping: Path | None
    postures: tuple[str, ...]  # such as `hook: MCP 0 PIP 65 DIP 50`
    yes: bool  # take all proposals, ask nothing


def new_session(options: NewOptions, json: str | None) -> None:
    """Make a session.

    Raises:
        InputError: something cannot be read, or is not known and cannot be asked for.
    """
    if (options.out / SESSION).exists():
        raise InputError(f"{options.out.name} has a session already", "a new folder", "Choose another --out")
    asking = not options.yes and at_terminal(json)
    header, own_finger = _known_header(options)
    notebook = _notebook(options)  # a file that is not there is said before anything is asked
    lacks = [key for key in REQUIRED if key not in header]
    rate_hz = (header.get("load_cell") or {}).get("rate_hz")
    with ExitStack() as held:
        recordings = [held.enter_context(as_recording(path)) for path in options.recordings]
        if lacks and not asking:
            raise InputError(
                f"{', '.join(lacks)} not known",
                "what no recording tells",
                "Give --setup FILE (bench-setup/1), or --like an earlier session of the rig",
            )
        mapping = _mapping(options, recordings, rate_hz, asking)
        with progress("Reading"):
            readings = held.enter_context(joined(recordings, mapping))
            levels = levels_of(readings)
        told = list(readings.notes)
        doubts = mapping.doubts if mapping and options.yes else ()
        told += [f"taken as proposed: {d}" for d in doubts if not d.startswith(OF_THE_FILE)]  # those are told already
        told.append(MASSES_IN_GRAMS)
        if asking:
            header |= _ask_header([*lacks, *([] if "load_cell" in header else ["load_cell"])])
            own_finger = own_finger or finger_file(header["finger"])
        finger = read_finger(own_finger or header["finger"])
        notes = _notes(notebook, finger.topology.muscles, asking)
        if not asking:  # what will be missing is said before the work is done
            _postures(options, [n.posture for n in notes if n.kind == "load"], finger, asking)
        with progress("Laying the notebook onto the plateaus"):
            laid = lay_notes(levels, notes)
        if laid.lost and not asking and not options.yes:
            raise InputError(
                "; ".join(laid.lost),
                "a line for each plateau under load, in order; 'skip' for one that is to be left out",
                "Correct the notebook there or nearby, or give --yes to leave out what has no counterpart",
            )
        if json != "-":
            _show(laid.levels, laid.choices)
        if asking:
            for line in laid.lost:
                say(f"  {line}")
            laid = LaidNotes(laid.levels, _asked(laid, finger.topology.muscles), laid.lost)
        postures = _postures(
            options, [c.note.posture for c in laid.choices if c.kind == "load" and c.note], finger, asking
        )
        told += laid.lost
        provenance = {"made_by": "fingertwin new", "recordings": [path.name for path in options.recordings]}
        if own_finger is not None:  # it goes along, so that the session is whole wherever it is taken
            header["finger"] = own_finger.name
        document = document_of(options.out.resolve().name, header, postures, laid, provenance)
        session = session_of(document)
        with writing(options.out):
            write_new(options.out, session, readings, mapping, own_finger)
    _report(options, document, laid.choices, told, still_missing(document), json)


def _report(
    options: NewOptions,
    document: Mapping[str, Any],
    choices: Sequence[Choice],
    notes: Sequence[str],
    missing: Sequence[str],
    json: str | None,
) -> None:

    found = check(options.out)
    alike, why_not = _suspects(options.out)
    unsure = sum(c.sure < SURE for c in choices)
    warnings = [f"{f.level}: {f.where}: {f.text}" for f in found.findings if f.level != "note"]
    body: dict[str, Any] = {"session": str(options.out), "cases": len(document["cases"]), "plateaus": len(choices)}
    body |= {"unsure": unsure, "sound": found.ok, "check": warnings, "notes": list(notes), "missing": list(missing)}
    body |= {"suspects": [vars(s) for s in alike]}
    if answer("new", body, json):
        return
    for line in (*notes, *warnings):
        say(f"  {line}")
    for s in alike:
        say(f"  look again at {s.case}: rather {s.words} (leaves {s.other:.0%} of the reading, the entry {s.own:.0%})")
    if why_not:
        say(f"  not held against the model: {why_not}")
    for line in missing:
        say(f"  missing for a diagnosis: {line}")
    said = f", {unsure} of {len(choices)} plateaus to look at" if unsure else ""
    say(f"{len(document['cases'])} load cases{said}: {options.out}   (fingertwin check {quoted(options.out)})")


def _suspects(folder: Path) -> tuple[list[Suspect], str]:
    """Return cases that look like something else, or why the model could not be held against the session."""
    try:
        with progress("Holding each case against the model"):
            return suspects(Session.open(folder, catalogue=False)), ""
    except InputError as error:
        return [], str(error)


def _known_header(options: NewOptions) -> tuple[dict[str, Any], Path | None]:
    """Return specimen, finger, cell and friction of an earlier session or setup, and the finger's file if it is one."""
    out: dict[str, Any] = {}
    folder: Path | None = None
    if options.like is not None:
        like = read_session(options.like)
        out |= header_of(plain_document(like))
        folder = like.folder
    if options.setup is not None:
        given = read_yaml(options.setup)
        if not isinstance(given, Mapping) or given.get("format") != "bench-setup/1":
            raise InputError(f"{options.setup.name} is not a setup", "format: bench-setup/1")
        out |= header_of(given)
        folder = options.setup.parent if "finger" in given else folder
    return out, finger_file(out["finger"], folder) if "finger" in out else None


def _ask_header(lacks: Sequence[str]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    if "specimen" in lacks:
        name = ask("Specimen, a pseudonym", str)
        species, digit = Prompt.ask("Species", default="human"), Prompt.ask("Digit", default="third")
        side = Prompt.ask("Side of the hand", choices=["left", "right"])
        out["specimen"] = {"id": name, "species": species, "digit": digit, "side": side}
    if "finger" in lacks:
        out["finger"] = ask_finger()
    if "tension_factor" in lacks:
        out["tension_factor"] = ask("Friction: a factor, or 'estimate' by force balance", _friction)
    if "load_cell" in lacks:
        model = Prompt.ask("Model of the load cell, such as ATI Nano17-E SI-25-0.25", default="", show_default=False)
        rate = ask("Sampling rate [Hz], 0 if not known", number, "0")
        cell = {"model": model or None, "rate_hz": rate if rate > 0.0 else None}
        mounts = {place: {"frame": bone} for place, bone in FRAMES.items()}
        out["load_cell"] = {k: v for k, v in cell.items() if v} | {"mounts": mounts}
    return out


def _friction(text: str) -> float | dict[str, str]:
    if text.lower() == "estimate":
        return {"estimate": "force_balance"}
    factor = number(text)
    if not 0.0 < factor <= LARGEST_FACTOR:
        raise InputError(f"a factor of {factor:g}", f"0 < factor ≤ {LARGEST_FACTOR}, such as 0.835, or 'estimate'")
    return factor


def _mapping(options: NewOptions, recordings: Sequence[Path], rate_hz: float | None, asking: bool) -> LabFileMap | None:
    """Return the confirmed mapping of channels; None where every recording is a readings file."""
    first = next((path for path in recordings if not is_readings_file(path)), None)
    if first is None:
        return None
    beside = [options.mapping, options.like / MAPPING if options.like else None]
    beside += [options.recordings[0].with_name(f"{options.recordings[0].name}.map.yaml")]
    known = next((path for path in beside if path is not None and (path.is_file() or path is options.mapping)), None)
    if known is not None:
        return read_mapping(known)
    if asking:
        confirmed = settled(first, None, rate_hz)
        if confirmed is None:
            raise InputError("the mapping was not confirmed", "a mapping", "Make one: fingertwin import RECORDING")
        return confirmed
    proposal = propose_mapping(first, None, rate_hz)
    if not options.yes:
        raise InputError("which channel is which was not confirmed", "--map FILE, or --yes to take the proposal")
    by_place = [key for key, ground in grounds(first, proposal).items() if ground.by_place]
    if by_place:
        raise InputError(
            f"only their place in {first.name} says which channels are {' '.join(by_place)}",
            "--map FILE: --yes takes no such proposal",
            "Run it without --yes, or 'fingertwin import', and confirm",
        )
    return proposal.model_copy(update={"confirmed": True})


def _notebook(options: NewOptions) -> str | None:
    """Return the text of the notebook; None where none was given."""
    if options.notes is None:
        return None
    wanted = "a notebook as text or CSV"
    try:
        return sys.stdin.read() if str(options.notes) == "-" else read_text(options.notes, wanted)
    except UnicodeDecodeError as error:
        raise InputError("standard input is not UTF-8 text", f"{wanted} in UTF-8", "Save it as UTF-8") from error


def _notes(text: str | None, tendons: Sequence[str], asking: bool) -> tuple[Note, ...]:
    if text is None and asking:
        example = "What hung, line by line, such as 'FDP 950, hook, tip'; masses in g; 'tare' where you noted one"
        text = lines(example, lambda typed, whole: notes_of(typed, tendons, whole))
    if text is None:
        raise InputError("no notebook", "--notes FILE with lines such as 'FDP 950, hook, tip'")
    return notes_of(text, tendons)


def _show(levels: Sequence[Level], choices: Sequence[Choice]) -> None:

    rows, tare = [], None
    for i, (level, choice) in enumerate(zip(levels, choices, strict=True), 1):
        if choice.kind == "tare":
            tare = level.plateau.mean
        change = (
            "" if tare is None or choice.kind != "load" else f"{np.linalg.norm((level.plateau.mean - tare)[:3]):.2f}"
        )
        what = said(choice.note) or choice.kind
        sure = f"{choice.sure:.2f}" + ("" if choice.sure >= SURE else " look")
        rows.append([str(i), f"{level.window_s[0]:g} to {level.window_s[1]:g}", change, what, sure])
    table("Plateaus", ["", "window [s]", "change [N]", "taken for", "sure"], rows)


def _asked(laid: LaidNotes, tendons: Sequence[str]) -> list[Choice]:
    """Let somebody change lines of the table until nothing more is to be changed."""
    choices = list(laid.choices)
    while True:
        while line := Prompt.ask(
            "Change one, such as '7 tare', '7 skip' or '7 FDP 300, hook, tip'; Enter takes all",
            default="",
            show_default=False,
        ):
            try:
                at, choice = _change(line, choices, tendons)
            except InputError as error:
                say(f"  {error}")
                continue
            choices[at] = choice
            say(f"  {at + 1} is now {said(choice.note) or choice.kind}")
        try:
            cases_of(laid.levels, choices)
        except InputError as error:
            say(f"  {error}")
            continue
        return choices


def _change(line: str, choices: Sequence[Choice], tendons: Sequence[str]) -> tuple[int, Choice]:
    """Return the plateau that a line names, and what it is to be.

    Raises:
        InputError: the line is not understood.
    """
    match = re.match(r"\s*(\d+)\s+(.*)", line)
    if match is None or not 1 <= int(match[1]) <= len(choices):
        raise InputError(f"{line!r}", f"a number from 1 to {len(choices)}, and what it is")
    at, what = int(match[1]) - 1, match[2].strip()
    # What is not said is as it was, or as of the load before.
    before = next((c.note for c in reversed(choices[: at + 1]) if c.kind == "load" and c.note), None)
    *_, note = notes_of(what if before is None else f"{said(before)}\n{what}", tendons, whole=False)
    return at, replace(choices[at], kind=note.kind, note=note if note.kind == "load" else None, sure=1.0)


def _postures(options: NewOptions, wanted: Sequence[str], finger: Finger, asking: bool) -> dict[str, dict[str, float]]:
    """Return angles of postures [deg]."""
    known: dict[str, dict[str, float]] = {}
    if options.like is not None:
        known |= plain_document(read_session(options.like)).get("postures_deg", {})
    known |= postures_of(options.postures, finger)
    lacks = lacking(wanted, known)
    if lacks and not asking:
        raise InputError(
            f"the angles of {', '.join(lacks)} are not known",
            f"--posture '{lacks[0]}: MCP 0 PIP 65 DIP 50' for each, in degrees, flexion positive",
        )
    return known | ask_postures(lacks, finger)
