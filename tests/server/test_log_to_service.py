"""`fingertwin log --to` and `replay --to`: what arrives at a service, what it refuses, and what is kept without it."""

from __future__ import annotations

import json
import signal
import threading
from pathlib import Path

import httpx
import numpy as np
import pytest

from daq.acquisition.blocks import Chunk
from daq.journal.reader import JournalReader
from daq.recordings.readings import ReadingBlock, open_readings, write_readings
from tests.contracts.ingest import SmallReceiver, serving
from tests.server.test_log_cli import run


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    t_s = np.arange(0.0, 30.0, 0.01)
    return write_readings(tmp_path / "played.csv", [ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))])


def test_a_replay_arrives_at_a_service_once_and_in_order(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    receiver = SmallReceiver(recording.parent / "received.sqlite3")
    session, out = receiver.new_session("monday-2"), recording.parent / "kept"
    with serving(receiver.handle) as address:
        arguments = ["replay", str(recording), "--to", address, "--session", session, "--out", str(out)]
        code, text, err = run(capsys, monkeypatch, *arguments)
    assert code == 0, err
    assert f"All is at {address}" in text
    with JournalReader.open(out / "journal.sqlite3") as journal:
        [stream] = journal.streams()
    chunks = [Chunk.from_bytes(payload) for payload in receiver.stored(session, stream.id)]
    sent = np.concatenate([b.wrench for b in open_readings(recording).blocks()])
    assert (np.concatenate([c.wrench for c in chunks]) == sent).all()
    assert {"started", "ended"} <= {e["kind"] for e in receiver.events(session)}
    receiver.close()


def test_what_a_service_refused_is_put_back_and_sent_by_the_next_log(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    receiver = SmallReceiver(recording.parent / "received.sqlite3")
    session, out = receiver.new_session("monday-2"), recording.parent / "kept"
    journal = str(out / "journal.sqlite3")
    with serving(receiver.handle) as address:
        arguments = ["replay", str(recording), "--to", address, "--session", session, "--out", str(out)]
        receiver.most_bytes = 1
        code, text, err = run(capsys, monkeypatch, *arguments)
        assert (code, "not all of" in err) == (2, True)
        assert f"Not all is at {address}: 0 chunks sent, 1 chunk refused and kept in the journal." in text
        logged = ["log", "--driver", "replay", "--port", journal, "--set", "speed=0", "--to", address]
        code, _, err = run(capsys, monkeypatch, *logged, "--session", session, "--out", str(out.with_name("logged")))
        assert (code, err.count("\n"), f"{address} refused 1 chunk; " in err) == (2, 1, True)
        code, text, _ = run(capsys, monkeypatch, "journal", "check", journal)
        assert "0 chunks wait to be sent, 1 that the service refused are set aside" in text
        code, text, _ = run(capsys, monkeypatch, "journal", "requeue", journal)
        assert code == 0
        assert f"{journal}: 1 chunk is to be sent again" in text
        code, text, _ = run(capsys, monkeypatch, "journal", "requeue", journal, "--json", "-")
        assert json.loads(text) == {"schema": "fingertwin/journal-requeue/1", "journal": journal, "chunks": 0}
        receiver.most_bytes = 1 << 20
        code, text, err = run(capsys, monkeypatch, *arguments)
        assert code == 0, err
    assert f"All is at {address} (2 chunks)" in text
    receiver.close()


def test_a_service_that_is_not_there_fails_in_one_line_and_loses_nothing(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.3)
    out = recording.parent / "kept"
    arguments = ["replay", str(recording), "--to", "http://127.0.0.1:9", "--out", str(out)]
    code, text, err = run(capsys, monkeypatch, *arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert f"The readings are in {out}" in err
    assert "Not all is at http://127.0.0.1:9" in text
    code, text, _ = run(capsys, monkeypatch, "journal", "check", str(out / "journal.sqlite3"))
    assert code == 0
    assert "1 chunk waits to be sent" in text


def test_a_log_that_is_not_all_sent_says_what_sends_the_rest(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.3)
    out = recording.parent / "kept"
    logged = ["log", "--driver", "replay", "--port", str(recording), "--set", "speed=0", "--out", str(out)]
    code, text, err = run(capsys, monkeypatch, *logged, "--to", "http://127.0.0.1:9")
    assert (code, err.count("\n")) == (2, 1)
    remedy = f"The next log into {out} with --to sends the rest."
    assert remedy in text
    assert remedy in err
    assert "3000 readings" in text


def test_a_replay_to_a_session_that_is_another_is_told_to_take_another_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.3)
    problem = {"detail": "session DEV-01 is there, and differs; expected another id"}
    with serving(lambda _: httpx.Response(409, json=problem)) as address:
        code, text, err = run(capsys, monkeypatch, "replay", "DEV-01", "--to", address, "--out", str(tmp_path / "kept"))
    assert (code, err.count("\n")) == (2, 1)
    assert f"fingertwin replay DEV-01 --to {address} --session NAME sends all under another name" in err
    assert f"409 {problem['detail']}" in text


def test_a_replay_that_ctrl_c_breaks_off_is_not_said_to_have_ended(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    receiver = SmallReceiver(recording.parent / "received.sqlite3")
    session = receiver.new_session("monday-2")

    pressed = threading.Event()

    def interrupting(request: httpx.Request) -> httpx.Response:
        answer = receiver.handle(request)
        if "/chunks/" in request.url.path and not pressed.is_set():
            pressed.set()
            signal.raise_signal(signal.SIGINT)
        return answer

    with serving(interrupting) as address:
        arguments = ["replay", str(recording), "--to", address, "--session", session, "--speed", "10"]
        code, text, err = run(capsys, monkeypatch, *arguments)
        assert (code, "All so far is at" in text, "All is at" in text) == (130, True, False)
        assert "not all of monday-2 was replayed; the same command replays all of it\n" in err
        assert "ended" not in {e["kind"] for e in receiver.events(session)}
        arguments[-1] = "max"
        assert run(capsys, monkeypatch, *arguments)[0] == 0
    assert [e["kind"] for e in receiver.events(session)].count("ended") == 1
    receiver.close()
