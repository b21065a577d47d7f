"""A bench that runs: its record, its forces as they come, and what it may not see before it is closed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.bench.record import BenchSetup
from daq.journal.reader import JournalReader
from daq.journal.writer import Journal
from daq.uplink.thread import Uplink
from fingermodel.fingers.files import read_finger
from server.service.answers import dumps
from tests.daq.bench_plays import (
    LONG_BLOCK_S,
    Bench,
    case,
    gone_on,
    hung,
    journalled,
    load,
    setup,
    tared,
    truth,
    wait,
    whole,
)
from tests.server.service.recorded import listed_as_answered
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/sessions"


class Played:
    """A bench whose journal goes to a service."""

    def __init__(self, folder: Path, run_setup: BenchSetup | None = None) -> None:
        self.service = ServiceReceiver(folder / "service")
        self.client = self.service.client()
        self.folder = folder / "bench"
        self.folder.mkdir()
        self.bench: Bench = journalled(self.folder, run_setup)
        self.send()

    def send(self) -> None:
        """Send all that is in the journal, and let the service look at it."""
        assert self.bench.journal is not None
        uplink = self.uplink(self.bench.journal)
        uplink.start()
        assert uplink.flush(300.0), uplink.status()
        uplink.stop()
        assert self.service.parts.case_updates.settle(120.0)

    def uplink(self, journal: Journal, bench: bool = True) -> Uplink:
        client = self.service.another()
        return Uplink(journal, "http://127.0.0.1", "S1", client=client, begins=True, bench=bench)

    def get(self, path: str) -> Any:
        return self.client.get(f"{AT}/S1{path}").json()

    def told(self) -> list[dict[str, Any]]:
        return [m.body for m in self.service.parts.messages.after(0) if m.kind == "case"]


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    out = Played(tmp_path)
    yield out
    if out.bench.journal is not None:
        out.bench.journal.close()
    out.service.close()


def without_end() -> list[Any]:
    """The whole protocol up to its last tare, not closed."""
    return whole()[:-1]


def test_a_bench_is_at_the_service_what_it_is_in_its_folder(played: Played) -> None:
    played.bench.play(whole(), block_s=LONG_BLOCK_S)
    played.send()
    listed = listed_as_answered(played.client, "S1")
    assert (listed["source"], listed["closed"], listed["specimen"]) == ("bench", True, "P1")
    assert [s["id"] for s in played.client.get(AT, params={"specimen": "P1"}).json()["sessions"]] == ["S1"]
    assert played.get("/document")["cases"] == played.bench.run.record.document()["cases"]
    results = {r.case: r for r in played.bench.run.results()}
    cases = {c["id"]: c for c in played.get("/cases")["cases"]}
    assert list(cases) == list(results) == ["c001", "c002", "c003", "c004"]
    for name, found in cases.items():
        assert found["measured_N"] == pytest.approx(results[name].force_N, abs=1e-9)
        assert found["measured_sd_N"] == pytest.approx(results[name].sd_N, abs=1e-9)
    compared = played.get("/comparison")
    assert [c["id"] for c in compared["cases"]] == list(cases)
    assert compared["blinded"] == []


def test_a_bench_brings_its_own_finger(tmp_path: Path) -> None:
    finger = read_finger("synek2019_optimised").document | {"id": "mine"}
    played = Played(tmp_path, setup(finger="mine.yaml", finger_document=finger))
    try:
        # Before the first reading the page draws it.
        assert played.client.get(f"{AT}/S1/bench/finger", params={"case": "c001"}).status_code == 200
        played.bench.play(whole(), block_s=LONG_BLOCK_S)
        played.send()
        assert played.get("/comparison")["model"] == "mine"
    finally:
        if played.bench.journal is not None:
            played.bench.journal.close()
        played.service.close()


def test_each_case_has_its_force_in_the_next_moment(played: Played) -> None:
    begun = ["next", *tared(), *case("tip", FDP=950)]
    played.bench.play(begun)
    played.send()
    (told,) = played.told()
    assert (told["id"], told["state"], told["blinded"]) == ("c001", "measured", False)
    assert told["predicted_N"] is not None
    played.bench.play([*tared(), "next", *hung(truth("tip", {"FDS": 950.0})), wait(0.5)])
    played.send()
    # The tare after the first case brackets it: its force is told anew.
    states = [(t["id"], t["state"]) for t in played.told()]
    assert (states[0], states[-1]) == (("c001", "measured"), ("c002", "measured"))
    assert len(played.told()) <= 4


def test_nothing_tells_of_a_validation_case_before_the_bench_closes_the_session(played: Played) -> None:
    played.bench.play(without_end(), block_s=LONG_BLOCK_S)
    played.send()
    assert listed_as_answered(played.client, "S1")["closed"] is False
    hidden = next(c for c in played.get("/cases")["cases"] if c["role"] == "validation")
    assert hidden["state"] == "measured"
    assert hidden["blinded"]
    assert (hidden["predicted_N"], hidden["residual_N"], hidden["z"]) == (None, None, None)
    compared = played.client.get(f"{AT}/S1/comparison").json()
    assert compared["blinded"] == [hidden["id"]]
    assert [c["id"] for c in compared["cases"]] == ["c001", "c002", "c004"]
    assert not [k for k in compared["summary"] if k.startswith("validation")]
    assert compared["by_posture"]["relaxed"]["space"]["cases"] == 1
    for path in ("diagnoses", "fits", "revisions", "next"):
        body = {"add": ["hanger_mass"]} if path == "revisions" else {}
        answer = played.client.post(f"{AT}/S1/{path}", json=body)
        assert answer.status_code == 409
        assert "bench" in answer.json()["detail"]
    assert played.client.get("/api/v1/friction", params={"session": "S1"}).status_code == 409
    assert played.client.post(f"{AT}/S1/close").status_code == 409
    assert played.client.post(f"{AT}/S1/cases/c003/exclude", json={"reason": "does not fit"}).status_code == 409
    assert all(t["predicted_N"] is None for t in played.told() if t["id"] == hidden["id"])
    played.bench.press("close")
    played.send()
    shown = played.get(f"/cases/{hidden['id']}")
    assert shown["predicted_N"] is not None
    assert played.told()[-1]["id"] == hidden["id"]
    assert played.told()[-1]["predicted_N"] == shown["predicted_N"]


def test_a_bench_that_crashed_and_went_on_is_one_session(played: Played) -> None:
    played.bench.play(["next", *tared(), *case("tip", FDP=950), load(truth("tip", {"FDS": 950.0})), wait(1.0)])
    played.send()
    assert played.bench.journal is not None
    played.bench.journal.close()
    played.bench = gone_on(played.folder, 60.0)
    played.bench.play([*tared(), "next", *case("tip", FDS=950), *tared(), "close"])
    played.send()
    assert {c["id"]: c["state"] for c in played.get("/cases")["cases"]} == {"c001": "measured", "c002": "measured"}
    assert len(played.get("")["streams"]) == 1


@pytest.mark.parametrize("at_once", [False, True])
def test_a_session_of_one_bench_is_not_taken_by_another(played: Played, tmp_path: Path, at_once: bool) -> None:
    """Nor where both were begun before either had said so: then its first event is refused."""
    before = played.get("")
    (tmp_path / "other").mkdir()
    other = journalled(tmp_path / "other", setup(specimen={**setup().specimen, "id": "P2"}))
    assert other.journal is not None
    uplink = played.uplink(other.journal, bench=not at_once)
    for _ in range(8):
        uplink.step()
    status = uplink.status()
    uplink.stop()
    if at_once:
        assert status.events_refused == 1
        assert other.journal.alarms.get_nowait()[0] == "event_refused"
    else:
        refusal = "409 session S1 is not this bench's; expected a name of its own. Give --session NAME"
        code, said = other.journal.alarms.get_nowait()
        assert (code, refusal in said, status.barred, status.sent) == ("session_refused", True, True, 0)
        assert played.get("") == before
    assert (played.get("")["specimen"], played.get("")["stream"]) == ("P1", played.bench.stream)
    other.journal.close()


def test_a_bench_has_its_session_also_from_a_copy_of_its_journal(played: Played) -> None:
    """Which is another history from there on."""
    assert played.bench.journal is not None
    epoch = played.bench.journal.epoch
    played.bench.journal.close(played.folder / "copy.ftj")
    played.bench.journal = Journal.open(played.folder / "copy.ftj", 0)
    assert played.bench.journal.epoch != epoch
    played.send()
    assert played.get("")["specimen"] == "P1"


def test_a_bench_takes_no_session_that_has_a_document(tmp_path: Path) -> None:
    service = ServiceReceiver(tmp_path / "service")
    document = setup().header() | {"cases": [{"id": "c001", "role": "identification", "posture": "hook",
        "location": "tip", "masses_g": {"FDP": 950.0}, "force_N": [0.0, 0.0, 0.0]}]}  # fmt: skip
    service.client().post(AT, json={"id": "S1", "document": document}).raise_for_status()
    bench = journalled(tmp_path)
    assert bench.journal is not None
    uplink = Uplink(bench.journal, "http://127.0.0.1", "S1", client=service.another(), begins=True, bench=True)
    uplink.start()
    began_s = time.monotonic()
    assert not uplink.flush(60.0), "what will not be taken is not waited for"
    assert time.monotonic() - began_s < 30.0
    assert uplink.status().barred
    uplink.stop()
    bench.journal.close()
    service.close()


def test_everything_that_the_bench_wrote_is_at_the_service_once(played: Played) -> None:
    played.bench.play(whole(), block_s=LONG_BLOCK_S)
    played.send()
    played.send()
    assert played.bench.journal is not None
    with JournalReader.open(played.folder / "bench.ftj") as kept:
        chunks = [c.to_bytes() for c in kept.read(played.bench.stream)]
        events = [(e.kind, dumps(dict(e.value))) for e in kept.events()]
    assert played.service.stored("S1", played.bench.stream) == chunks
    assert [(e["kind"], dumps(e["value"])) for e in played.service.events("S1")] == events
