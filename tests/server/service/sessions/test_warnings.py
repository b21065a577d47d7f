"""Warnings of the check at the service: those of the command line, though each reading is looked at once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.blocks import Chunk
from daq.checks import RecordingScan
from daq.recordings.readings import ReadingBlock
from fingermodel.session import Session
from server.application.provenance import provenance
from server.service.jobs.task_kinds import Tasks
from tests.daq.benches import record, recorded, save
from tests.server.service.recorded import describe, put
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/sessions/S1"
ROWS = 250


def rough() -> ReadingBlock:
    """Two cases, a gap in the first load and one long after all windows, and a channel that is stuck for a while."""
    block = record([np.zeros(6), np.full(6, 1.0)] * 3, noise=0.01)
    block.wrench[820:980, 2] = 0.0
    kept = (np.abs(block.t_s - 6.0) > 0.2) & (np.abs(block.t_s - 22.0) > 0.1)
    return ReadingBlock(block.t_s[kept], block.wrench[kept])


def chunks(block: ReadingBlock) -> Iterator[Chunk]:
    """The same as chunks, an empty one at the end."""
    for first in range(0, len(block) + ROWS, ROWS):
        t_s = block.t_s[first : first + ROWS]
        none = np.zeros(len(t_s), dtype=np.int64)
        yield Chunk(min(first, len(block)), t_s, block.wrench[first : first + ROWS], none, none > 0, b"", [], 1e9)


def warned(client: Any, path: str = f"{AT}/comparison") -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.get(path).raise_for_status().json()["warnings"]
    return found


def test_the_service_warns_of_all_that_the_command_line_does(
    tmp_path: Path, fresh: ServiceReceiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at: list[int] = []
    take = RecordingScan.take
    data, block = recorded(2), rough()
    expected = provenance(Session.open(str(save(tmp_path / "S1", data, block)), catalogue=False))["warnings"]
    assert {"gaps", "gap_in_window", "stuck_channel"} <= {w["code"] for w in expected}

    def counted(scan: RecordingScan, readings: ReadingBlock) -> None:
        looked_at.append(len(readings))
        take(scan, readings)

    monkeypatch.setattr(RecordingScan, "take", counted)
    client = fresh.client()
    client.post("/api/v1/sessions", json={"id": "S1", "document": data}).raise_for_status()
    describe(client, "S1")
    for chunk in chunks(block):
        put(client, "S1", chunk).raise_for_status()
        assert fresh.parts.case_updates.settle(60.0)
        client.get(f"{AT}/cases").raise_for_status()
    assert warned(client) == warned(client, AT) == expected
    parts = fresh.parts
    of_job = Tasks(parts.settings, parts.database, parts.measuring, parts.models, parts.revisions, parts.effects)
    job = of_job.bench({"session": "S1", "model": None}).open()
    assert [f.as_warning() for f in job.findings] == expected
    client.post(f"{AT}/cases/c001/exclude", json={"reason": "slipped"}).raise_for_status()
    codes = {w["code"] for w in warned(client)}
    assert {"gaps", "stuck_channel"} <= codes
    assert "gap_in_window" not in codes
    assert sum(looked_at) == len(block)


def test_readings_behind_a_hole_are_looked_at_once_it_is_filled(fresh: ServiceReceiver) -> None:
    client, block = fresh.client(), rough()
    client.post("/api/v1/sessions", json={"id": "S1", "document": recorded(2)}).raise_for_status()
    describe(client, "S1")
    *sent, late, end = chunks(block)
    for chunk in (*sent[1:], late, end):
        put(client, "S1", chunk).raise_for_status()
    client.get(AT).raise_for_status()
    put(client, "S1", sent[0]).raise_for_status()
    assert {"gaps", "gap_in_window", "stuck_channel"} <= {w["code"] for w in warned(client)}
