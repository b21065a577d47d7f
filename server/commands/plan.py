"""`fingertwin plan`: finger, postures, protocol and a bench sheet, asked for step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.files import read_text
from daq.quoting import counted, quoted
from daq.sessions.protocols import Protocol, protocol_names, read_protocol
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.fingers.finger import Finger
from fingermodel.studies.scaling import scale_finger, write_scaled
from server.application.bench_plan import (
    FINGER,
    NOTES,
    PROTOCOL,
    SHEET,
    in_postures,
    protocol_of,
    require_fits,
    write_plan,
)
from server.application.exporting import writing
from server.application.new_session import lacking, notes_of
from server.commands.console import answer, at_terminal, progress, say
from server.commands.questions import ask, ask_finger, ask_postures, lines, number, postures_of
from server.commands.scaling import measures


@dataclass(frozen=True)
class PlanOptions:
    """Arguments of the command."""

    out: Path  # folder of the plan
    finger: str | None  # shipped name or file
    # Such as `PP=40.1`; moment_arms: such as `FDP@MCP=10.2`; references: of the finger's own bones.
    bones: Sequence[str]
    moment_arms: Sequence[str]
    references: Sequence[str]
    protocol: str | None  # shipped name or file; loads: file with lines such as `FDP 950, hook, tip` instead
    loads: Path | None
    postures: Sequence[str]  # such as `hook: MCP 0 PIP 65 DIP 50`; only: names of those to keep
    only: Sequence[str]
    title: str | None  # of the sheet


def plan_bench(options: PlanOptions, json: str | None) -> None:
    """Write a plan's folder.

    Raises:
        InputError: something cannot be used, or is not known and cannot be asked for.
    """
    if (options.out / PROTOCOL).exists():
        raise InputError(f"{options.out.name} has a plan already", "a new folder", "Choose another --out")
    if options.protocol is not None and options.loads is not None:
        raise InputError("--protocol with --loads", "one of the two")
    asking = at_terminal(json)
    finger, bones, scaled = _finger(options, asking)
    protocol = _protocol(options, finger, asking)
    require_fits(protocol, finger)
    with progress("Writing the sheet"), writing(options.out):
        told = write_plan(
            options.out, protocol, finger, list(bones.items()), options.title or options.out.resolve().name
        )
        if scaled is not None:
            write_scaled(scaled, options.out / FINGER)
    named = str(options.out / FINGER) if scaled else finger.id
    body: dict[str, Any] = {"plan": str(options.out), "finger": named, "sheet": str(options.out / SHEET), **told}
    if answer("plan", body, json):
        return
    for line in scaled.assumptions if scaled else ():
        say(f"  {line}")
    heaviest = ", ".join(f"{tendon} {mass:g} g" for tendon, mass in told["heaviest_g"].items())
    say(f"  weights to have ready, at most: {heaviest}")
    say(
        f"{told['cases']} load cases, at least {told['length_s'] / 60:.0f} min; "
        f"{counted(told['pages'], 'page')}: {options.out / SHEET}"
    )
    say(
        f"Run it: fingertwin log … --protocol {quoted(options.out / PROTOCOL)}; "
        f"or record, and then: fingertwin new … --notes {quoted(options.out / NOTES)}"
    )


def _finger(options: PlanOptions, asking: bool) -> tuple[Finger, Mapping[str, float], Any]:
    """Return the finger, lengths of bones that were given [mm], and how it was scaled; None where it was not."""
    name, bones, arms = options.finger, list(options.bones), list(options.moment_arms)
    if name is None and asking:
        name = ask_finger()
    if name is None:
        raise InputError("no finger", f"--finger FILE, or one of {', '.join(finger_names())}")
    base = read_finger(name)
    if asking and not bones:
        return _measured(options, name, base)
    lengths = measures(bones, "--bone", "PP=40.1")
    if not lengths:
        if arms:
            raise InputError("moment arms without a bone length", "--bone BONE=MM for one bone at least")
        return base, {}, None
    return _scaled(options, name, lengths, measures(arms, "--moment-arm", "FDP@MCP=10.2"))


def _measured(options: PlanOptions, name: str, base: Finger) -> tuple[Finger, Mapping[str, float], Any]:
    """Ask for lengths and moment arms until a finger can be scaled to them; without a length it stays as it is."""
    while True:
        say("Lengths of the specimen's bones in mm, joint to joint; Enter leaves one to the mean of the others")
        asked = {bone: ask(f"  {bone}", _length, "") for bone in base.topology.bones[1:]}
        lengths = {bone: length for bone, length in asked.items() if length is not None}
        if not lengths:
            return base, {}, None
        given = measures(options.moment_arms, "--moment-arm", "FDP@MCP=10.2")
        arms = given or ask("Measured moment arms, such as FDP@MCP=10.2 FDS@PIP=6.6, or Enter", _arms, "")
        try:
            return _scaled(options, name, lengths, arms)
        except InputError as error:
            say(f"  {error}")


def _scaled(
    options: PlanOptions, name: str, lengths: Mapping[str, float], arms: Mapping[str, float]
) -> tuple[Finger, Mapping[str, float], Any]:
    references = measures(options.references, "--reference", "DP=19.0")
    with progress("Scaling"):
        scaled = scale_finger(name, lengths, arms, references, options.out.resolve().name)
    return scaled.finger, lengths, scaled


def _length(text: str) -> float | None:
    if not text:
        return None
    length = number(text)
    if not length > 0.0:
        raise InputError(f"{length:g} mm", "a length above 0 mm, joint to joint, or Enter")
    return length


def _arms(text: str) -> dict[str, float]:
    return measures(text.split(), "a moment arm", "FDP@MCP=10.2")


def _protocol(options: PlanOptions, finger: Finger, asking: bool) -> Protocol:
    postures = postures_of(options.postures, finger)
    name, loads = options.protocol, None
    if options.loads is not None:
        loads = read_text(options.loads, "loads as text or CSV")
    if name is None and loads is None and asking:
        name = ask(
            f"Protocol: a file, one of {', '.join(protocol_names())}, or 'own' to type the loads",
            lambda text: _fitting(text, finger),
            "levels",
        )
        if name == "own":
            example = "What hangs, line by line, such as 'FDP 950, hook, tip'; masses in g"
            loads = lines(example, lambda typed, whole: notes_of(typed, finger.topology.muscles, whole))
    if loads is not None:
        notes = notes_of(loads, finger.topology.muscles)
        if asking:
            postures |= ask_postures(lacking([n.posture for n in notes if n.kind == "load"], postures), finger)
        return protocol_of(notes, postures, options.out.resolve().name)
    if name is None:
        raise InputError("no loads", f"--protocol FILE or one of {', '.join(protocol_names())}, or --loads FILE")
    protocol, only = read_protocol(name), options.only
    if asking and not only and not postures:
        for posture, angles in protocol.postures_deg.items():
            say(f"  {posture}: {' '.join(f'{joint} {angle:g}' for joint, angle in angles.items())}")
        only = ask("Postures to keep, or Enter for all", lambda text: _kept(text, protocol), "")
    return in_postures(protocol, postures, only)


def _fitting(text: str, finger: Finger) -> str:
    """Return the name of a protocol that a finger can be loaded by, or `own`."""
    if text != "own":
        require_fits(read_protocol(text), finger)
    return text


def _kept(text: str, protocol: Protocol) -> tuple[str, ...]:
    only = tuple(text.replace(",", " ").split())
    in_postures(protocol, {}, only)
    return only
