"""`fingertwin plan`: finger, postures, protocol and a bench sheet, asked for step by step."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.prompt import Prompt

from daq.errors import InputError
from daq.lab.drafts import posture_of
from daq.sessions.protocols import Protocol, protocol_names, read_protocol
from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_names, read_finger
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
from server.commands.console import answer, progress, say
from server.commands.scaling import measures


@dataclass(frozen=True)
class PlanOptions:
    """What the command was given.

    Attributes:
        out: folder of the plan.
        finger: shipped name or file.
        bones: such as `PP=40.1`; moment_arms: such as `FDP@MCP=10.2`; references: of the finger's own bones.
        protocol: shipped name or file; loads: file with lines such as `FDP 950, hook, tip` instead.
        postures: such as `hook: MCP 0 PIP 65 DIP 50`; only: names of those to keep.
        title: of the sheet.
    """

    out: Path
    finger: str | None
    bones: tuple[str, ...]
    moment_arms: tuple[str, ...]
    references: tuple[str, ...]
    protocol: str | None
    loads: Path | None
    postures: tuple[str, ...]
    only: tuple[str, ...]
    title: str | None


def plan_bench(options: PlanOptions, json: str | None) -> None:
    """Write a plan's folder.

    Raises:
        InputError: something cannot be used, or is not known and cannot be asked for.
    """
    if (options.out / PROTOCOL).exists():
        raise InputError(f"{options.out.name} has a plan already", "a new folder", "Choose another --out")
    if options.protocol is not None and options.loads is not None:
        raise InputError("--protocol with --loads", "one of the two")
    asking = json != "-" and sys.stdin.isatty() and sys.stdout.isatty()
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
        f"{told['pages']} pages: {options.out / SHEET}"
    )
    say(
        f"Run it: fingertwin log … --protocol {options.out / PROTOCOL}; "
        f"or record, and then: fingertwin new … --notes {options.out / NOTES}"
    )


def _finger(options: PlanOptions, asking: bool) -> tuple[Finger, Mapping[str, float], Any]:
    """The finger, lengths of bones that were given [mm], and how it was scaled; None where it was not."""
    name, bones, arms = options.finger, list(options.bones), list(options.moment_arms)
    if name is None and asking:
        name = Prompt.ask(f"Finger: a file, or one of {', '.join(finger_names())}", default="an1979_middle")
    if name is None:
        raise InputError("no finger", f"--finger FILE, or one of {', '.join(finger_names())}")
    base = read_finger(name)
    if asking and not bones:
        say("Lengths of the specimen's bones in mm, joint to joint; Enter leaves one to the mean of the others")
        given = {bone: Prompt.ask(f"  {bone}", default="") for bone in base.topology.bones[1:]}
        bones = [f"{bone}={text}" for bone, text in given.items() if text]
        if bones:
            said = Prompt.ask("Measured moment arms, such as FDP@MCP=10.2 FDS@PIP=6.6, or Enter", default="")
            arms = said.split()
    lengths = measures(bones, "--bone", "PP=40.1")
    if not lengths:
        if arms:
            raise InputError("moment arms without a bone length", "--bone BONE=MM for one bone at least")
        return base, {}, None
    references = measures(options.references, "--reference", "DP=19.0")
    arms_mm = measures(arms, "--moment-arm", "FDP@MCP=10.2")
    with progress("Scaling"):
        scaled = scale_finger(name, lengths, arms_mm, references, options.out.resolve().name)
    return scaled.finger, lengths, scaled


def _protocol(options: PlanOptions, finger: Finger, asking: bool) -> Protocol:

    postures = dict(posture_of(text) for text in options.postures)
    name, loads = options.protocol, None
    if options.loads is not None:
        try:
            loads = options.loads.read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{options.loads} cannot be read ({error})", "loads as text or CSV") from error
    if name is None and loads is None and asking:
        name = Prompt.ask(
            f"Protocol: a file, one of {', '.join(protocol_names())}, or 'own' to type the loads", default="levels"
        )
        if name == "own":
            loads = _typed()
    if loads is not None:
        notes = notes_of(loads, finger.topology.muscles)
        postures |= _asked([n.posture for n in notes if n.kind == "load"], postures) if asking else {}
        return protocol_of(notes, postures, options.out.resolve().name)
    if name is None:
        raise InputError("no loads", f"--protocol FILE or one of {', '.join(protocol_names())}, or --loads FILE")
    protocol, only = read_protocol(name), options.only
    if asking and not only and not postures:
        for posture, angles in protocol.postures_deg.items():
            say(f"  {posture}: {' '.join(f'{joint} {angle:g}' for joint, angle in angles.items())}")
        only = tuple(Prompt.ask("Postures to keep, or Enter for all", default="").replace(",", " ").split())
    return in_postures(protocol, postures, only)


def _typed() -> str:
    say("What hangs, line by line, such as 'FDP 950, hook, tip'; masses in g; an empty line ends")
    lines = []
    while line := input("  ").strip():
        lines.append(line)
    return "\n".join(lines)


def _asked(names: Sequence[str], known: Mapping[str, Any]) -> dict[str, dict[str, float]]:

    return {
        name: posture_of(f"{name}: {input(f'Angles of {name} [deg], such as MCP 0 PIP 65 DIP 50: ')}")[1]
        for name in lacking(names, known)
    }
