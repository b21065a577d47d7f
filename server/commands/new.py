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
from rich.prompt import Confirm, FloatPrompt, Prompt

from daq.checks import check
from daq.errors import InputError
from daq.lab.drafts import Choice, is_readings_file, joined, posture_of, still_missing
from daq.lab.files import LabFileMap, read_mapping
from daq.lab.levels import Level
from daq.lab.notebook import Note, read_notes
from daq.lab.proposals import propose_mapping
from daq.lab.traces import as_recording
from daq.sessions import plain_document, read_session, read_yaml
from fingermodel.fingers.files import finger_names, read_finger
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
from server.application.workflow import open_bench
from server.commands.console import answer, progress, say, table
from server.commands.lab_files import show_proposal


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
    told.append(MASSES_IN_GRAMS)
    notes = _notes(options, header["finger"], asking)
    if not asking:  # what will be missing is said before the work is done
        _postures(options, [n.posture for n in notes if n.kind == "load"], asking)
    with progress("Laying the notebook onto the plateaus"):
        laid = lay_notes(levels_of(blocks), notes)
    if json != "-":
        _show(laid.levels, laid.choices)
        for line in laid.lost:
            say(f"  {line}")
    if asking:
        laid = LaidNotes(laid.levels, _asked(laid.choices, header["finger"]), laid.lost)
    postures = _postures(options, [c.note.posture for c in laid.choices if c.kind == "load" and c.note], asking)
    told += laid.lost
    provenance = {"made_by": "fingertwin new", "recordings": [path.name for path in options.recordings]}
    document = document_of(options.out.resolve().name, header, postures, laid, provenance)
    session = session_of(document)
    with writing(options.out):
        write_new(options.out, session, blocks, mapping)
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
    say(f"{len(document['cases'])} load cases{said}: {options.out}   (fingertwin check {options.out})")


def _suspects(folder: Path) -> tuple[list[Suspect], str]:
    """Cases that look like something else, or why the model could not be held against the session."""
    try:
        with progress("Holding each case against the model"):
            return suspects(open_bench(folder)), ""
    except InputError as error:
        return [], str(error)


def _header(options: NewOptions, asking: bool) -> dict[str, Any]:
    """Specimen, finger, cell and friction: of an earlier session, of a setup, or asked for."""
    out: dict[str, Any] = {}
    if options.like is not None:
        out |= header_of(plain_document(read_session(options.like)))
    if options.setup is not None:
        given = read_yaml(options.setup)
        if not isinstance(given, Mapping) or given.get("format") != "bench-setup/1":
            raise InputError(f"{options.setup.name} is not a setup", "format: bench-setup/1")
        out |= header_of(given)
    lacks = [key for key in REQUIRED if key not in out]
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


def _asked(choices: list[Choice], finger: str) -> list[Choice]:
    """Let somebody change lines of the table until nothing more is to be changed."""
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
    known: dict[str, dict[str, float]] = {}
    if options.like is not None:
        known |= plain_document(read_session(options.like)).get("postures_deg", {})
    known |= dict(posture_of(text) for text in options.postures)
    lacks = lacking(wanted, known)
    if lacks and not asking:
        raise InputError(
            f"the angles of {', '.join(lacks)} are not known",
            f"--posture '{lacks[0]}: MCP 0 PIP 65 DIP 50' for each, in degrees, flexion positive",
        )
    for name in lacks:
        known[name] = posture_of(f"{name}: {input(f'Angles of {name} [deg], such as MCP 0 PIP 65 DIP 50: ')}")[1]
    return known
