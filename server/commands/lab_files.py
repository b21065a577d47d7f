"""`fingertwin import`: a lab's recording as a readings file, by a mapping that a person confirms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.audit import note
from daq.errors import InputError
from daq.export.tables import sha256_of
from daq.files import is_special
from daq.lab.files import convert_recording, write_mapping
from daq.lab.proposals import propose_mapping
from server.commands.console import answer, at_terminal, progress, say
from server.commands.mapping_dialogue import settled, show_proposal, words


def import_recording(
    recording: Path, mapping: Path | None, calibration: str | None, out: Path | None, json: str | None
) -> None:
    """Convert by a confirmed mapping; without one propose it, and ask where there is somebody to ask.

    Raises:
        InputError: the file or the mapping cannot be used, or the mapping is still to be confirmed.
    """
    if recording.is_dir():  # whose name may be empty, so that none can stand beside it
        raise InputError(f"{recording} is a folder", "a recording", "Name a file in it")
    if mapping is None:
        mapping = recording.with_name(f"{recording.name}.map.yaml")
        if not mapping.exists() and not _proposed(recording, mapping, calibration, json):
            return
    elif calibration is not None:
        raise InputError("--calibration with --map", "one of the two", "Write the calibration into the mapping")
    target = out or Path(f"{recording.stem}.parquet")
    if target.resolve() == recording.resolve():
        raise InputError(f"{target} is the recording", "another file for the readings", "Give it: --out FILE")
    with progress("Reading and writing"):
        done = convert_recording(recording, mapping, target)
    if not is_special(target):
        told = {"recording": recording.name, "mapping_sha256": sha256_of(mapping), "sha256": sha256_of(target)}
        note(target.parent, "import", target.name, told)
    body: dict[str, Any] = {"recording": str(recording), "mapping": str(mapping), "readings": str(target)}
    body |= {"conversions": list(done.conversions), "notes": list(done.notes)}
    if not answer("import", body, json):
        for line in (*done.conversions, *done.notes):
            say(f"  {line}")
        say(f"{recording.name}: {target}")


def _proposed(recording: Path, mapping: Path, calibration: str | None, json: str | None) -> bool:
    """Write a proposal; return whether somebody at the terminal confirmed it."""
    if at_terminal(json):
        confirmed = settled(recording, calibration)
        if confirmed is not None:
            write_mapping(mapping, confirmed)
            return True
    proposal = propose_mapping(recording, calibration)
    write_mapping(mapping, proposal)
    said, channels = words(proposal)
    body: dict[str, Any] = {"recording": str(recording), "mapping": str(mapping), "confirmed": False, "time": said}
    if answer("import", {**body, "channels": channels, "doubts": list(proposal.doubts)}, json):
        return False
    show_proposal(recording.name, proposal)
    say(f"Written to {mapping}: look at it, set confirmed: true, and run the same command again.")
    return False
