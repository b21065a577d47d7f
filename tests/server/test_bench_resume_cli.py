"""`fingertwin log --protocol` killed in the middle and gone on with `--resume`: one sound session, each case once."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
import yaml

from daq.journal.reader import JournalReader
from daq.recordings.readings import ReadingBlock, write_readings
from daq.sessions import read_session
from daq.signals.corrections import measure
from tests.contracts.ingest import SmallReceiver, serving
from tests.server.test_log_cli import played, run

PROTOCOL = {
    "format": "protocol/1",
    "id": "small",
    "postures_deg": {
        "hook": {"MCP": 0, "PIP": 65, "DIP": 50, "abduction": 0},
        "relaxed": {"MCP": 20, "PIP": 30, "DIP": 15, "abduction": 0},
    },
    "timing": {"tare_s": 0.8, "load_s": 0.8, "settle_s": 0.1, "guard_s": 0.1},
    "blocks": [
        {"role": "identification", "location": "tip", "postures": ["hook"], "masses_g": [{"FDP": 950}, {"FDS": 950}],
         "repeat_first": True},
        {"role": "validation", "location": "tip", "postures": ["relaxed"], "masses_g": [{"FDP": 300, "FDS": 300}]},
    ],
}  # fmt: skip
SETUP = {
    "format": "bench-setup/1",
    "id": "P1-rig",
    "specimen": {"id": "P1", "species": "human", "digit": "third", "side": "right"},
    "finger": "an1979_middle",
    "load_cell": {"model": "Robotiq FT300", "serial": "FT1", "calibration": "C1"},
    "tension_factor": 0.835,
}
WAITED_S = 120.0


class Logger:
    """A `fingertwin log` of its own process, driven by lines."""

    def __init__(self, arguments: list[str]) -> None:
        self.process = subprocess.Popen(  # noqa: S603 - our own command
            [sys.executable, "-m", "server.cli", *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self.said: list[str] = []
        self._patience = Timer(WAITED_S, self.process.kill)
        self._patience.start()

    def say(self, *lines: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("".join(line + "\n" for line in lines))
        self.process.stdin.flush()

    def until(self, word: str) -> str:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.append(line)
            if word in line:
                return line
        raise AssertionError(f"ended without {word!r}: {''.join(self.said)}")

    def tare(self) -> None:
        self.say("tare")
        self.until("tare; window")

    def take(self) -> str:
        """Hang what is asked for, wait for the plateau, confirm; return what was measured."""
        self.say("loaded")
        self.until("plateau found; state loaded")
        self.say("confirm")
        return self.until("measured; case")

    def kill(self) -> None:
        """End it as a power cut does."""
        self.process.kill()
        self.end()

    def end(self) -> int:
        out = self.process.communicate()[0]
        self.said.append(out)
        self._patience.cancel()
        return self.process.returncode


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[list[str]]:
    """A stand-in that plays noise, and the command that logs it."""
    driver = getattr(request, "param", "robotiq-ft300")
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(yaml.safe_dump(PROTOCOL))
    Path("setup.yaml").write_text(yaml.safe_dump(SETUP))
    t_s = np.arange(0.0, 300.0, 0.01)
    noise = np.random.default_rng(0).normal(size=(len(t_s), 6)) * np.array([0.03] * 3 + [0.8] * 3)
    recording = write_readings(tmp_path / "noise.csv", [ReadingBlock(t_s, noise)])
    process, said = played(recording, driver, "--seconds", "300")
    # What the device must be told, as the stand-in says.
    line = said["log_with"].split()
    told = [part for at, word in enumerate(line) if word == "--set" for part in line[at : at + 2]]
    yield ["log", "--driver", driver, *told, "--port", said["address"], "--protocol", "small.yaml", "--setup",
           "setup.yaml", "--out", "out"]  # fmt: skip
    process.kill()
    process.communicate()


def test_a_killed_bench_goes_on_where_it_stopped(
    bench: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Logger(bench)
    first.until("bench started")
    first.say("next")
    first.tare()
    measured = [first.take()]
    first.say("repeat")
    measured.append(first.take())
    first.say("exclude c001r1 it slipped", "next", "loaded")
    first.until("plateau found; state loaded")
    first.kill()

    def refused(said: str, *arguments: str) -> None:
        code, text, err = run(capsys, monkeypatch, *arguments)
        assert (code, text, err.count("\n")) == (2, "", 1)
        assert said in err

    # Of one setup several days are made: each is called as its folder.
    refused("holds session out, which is not finished; expected --resume to go on with it", *bench)
    Path("other.yaml").write_text(yaml.safe_dump(SETUP | {"tension_factor": 0.9}))
    Path("levels.yaml").write_text(yaml.safe_dump(PROTOCOL | {"timing": PROTOCOL["timing"] | {"load_s": 1.0}}))  # type: ignore[operator]
    changed = {"setup.yaml": "tension_factor is 0.9; expected 0.835", "small.yaml": "protocol small is not that of"}
    for (given, said), other in zip(changed.items(), ("other.yaml", "levels.yaml"), strict=True):
        refused(said, *[other if a == given else a for a in bench], "--resume")
    assert not Path("out/session.yaml").exists()

    second = Logger([*bench, "--resume"])
    second.until("bench resumed")
    second.say("loaded")
    assert "c002 has no tare" in second.until("refused")
    second.tare()
    for case in ("c002", "c003"):
        assert f"case {case};" in second.take()
        second.say("next")
    second.say("posture_set")
    second.tare()
    # Blind before the crash, and blind now.
    assert "predicted" not in second.take()
    second.say("close")
    assert second.end() == 0, "".join(second.said)
    assert "predicted" in second.said[-1]

    code, text, _ = run(capsys, monkeypatch, "check", "out")
    assert (code, "usable" in text) == (0, True)
    session = read_session("out")
    assert session.id == "out"
    assert {c.id: c.repeat_of for c in session.cases} == {
        "c001": None, "c001r1": "c001", "c002": None, "c003": "c001", "c004": None,
    }  # fmt: skip
    assert [c.excluded for c in session.cases] == [None, "it slipped", None, None, None]
    # What was measured before the crash is in the session, and what was not confirmed is measured after it.
    told = [float(x) for x in measured[0].split("force_N (")[1].split(")")[0].split()]
    assert measure(session).cases[0].wrench[:3] == pytest.approx(told, abs=2e-6)
    [pause] = [e.t_s for e in session.events if "broke off" in (e.text or "")]
    assert [c.unloaded_s is not None and c.unloaded_s[0] > pause for c in session.cases] == [False] * 2 + [True] * 3
    code, text, _ = run(capsys, monkeypatch, "journal", "check", "out/journal.sqlite3")
    assert code == 0, text
    with JournalReader.open("out/journal.sqlite3") as journal:
        [stream] = journal.streams()
        assert [e.kind for e in journal.events() if e.kind in ("started", "ended")] == ["started", "started", "ended"]
        assert sum(len(c) for c in journal.read(stream.id)) == journal.next_seq(stream.id)
    # The bytes of both parts decode to the same readings again.
    again = ["log", "--driver", "replay", "--port", "out/journal.sqlite3", "--out", "again", "--set", "speed=0"]
    code, text, err = run(capsys, monkeypatch, *again, "--json", "-")
    assert code == 0, err
    with JournalReader.open("out/journal.sqlite3") as journal:
        assert json.loads(text)["samples"] == journal.next_seq(stream.id)
    refused("out has a session already, so nothing broke off", *bench, "--resume")


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be sent Ctrl-C alone there")
def test_a_bench_that_ctrl_c_ended_says_what_is_left_and_goes_on(bench: list[str]) -> None:
    first = Logger(bench)
    first.until("bench started")
    first.say("next")
    first.tare()
    first.take()
    first.process.send_signal(signal.SIGINT)
    assert first.end() == 130, "".join(first.said)
    assert "5 of 6 steps not done; the same command with --resume goes on." in first.said[-1]
    # Without a session nobody sees what validation cases were predicted before they are measured.
    assert not Path("out/session.yaml").exists()
    second = Logger([*bench, "--resume"])
    second.until("bench resumed")
    second.say("quit")
    assert second.end() == 0, "".join(second.said)
    assert "1 load case, 5 of 6 steps not done: out" in second.said[-1]
    assert [c.id for c in read_session("out").cases] == ["c001"]


@pytest.mark.parametrize("bench", ["robotiq-ft300", "text-lines"], indirect=True)
def test_a_session_that_was_closed_and_not_written_is_written(
    bench: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Logger(bench)
    first.until("bench started")
    first.say("next")
    first.tare()
    first.take()
    first.say("close")
    assert first.end() == 0
    written = Path("out/session.yaml").read_text()
    Path("out/session.yaml").unlink()
    code, _, err = run(capsys, monkeypatch, *bench)
    assert (code, "which was closed and never written; expected --resume" in err) == (2, True)
    # The load cell is not asked for.
    bench[bench.index("--port") + 1] = "socket://127.0.0.1:9"
    code, text, err = run(capsys, monkeypatch, *bench, "--resume")
    assert code == 0, err
    assert "1 load case:" in text
    assert Path("out/session.yaml").read_text() == written
    # Nor is it where the service was away until the session was closed, or is still.
    with monkeypatch.context() as impatient:
        impatient.setattr("server.commands.forwarding.FLUSH_S", 0.3)
        code, text, err = run(capsys, impatient, *bench, "--resume", "--to", "http://127.0.0.1:9")
    assert (code, err.count("\n"), err.count("The same command with --resume sends the rest")) == (2, 1, 1)
    assert "Not all is at http://127.0.0.1:9 (no answer" in text
    assert "the rest waits in the journal. The same command with --resume sends the rest.\n" in text
    receiver = SmallReceiver(Path("received.sqlite3"))
    with serving(receiver.handle) as address:
        sent = [*bench, "--resume", "--to", address, "--session", receiver.new_session("day")]
        code, text, err = run(capsys, monkeypatch, *sent)
    assert (code, f"All is at {address}" in text) == (0, True), err
    with JournalReader.open("out/journal.sqlite3") as journal:
        [stream] = journal.streams()
        assert len(receiver.stored("day", stream.id)) == sum(1 for _ in journal.read(stream.id))
    assert receiver.events("day")[-1]["kind"] == "ended"
    receiver.close()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--resume"], "--resume alone; expected the --protocol and --setup that the session began with"),
        (["--resume", "--protocol", "small.yaml"], "--protocol without --setup"),
        (["--resume", "--protocol", "small.yaml", "--setup", "setup.yaml"], "out holds no unfinished bench session"),
    ],
)
@pytest.mark.parametrize("logged", [False, True])
def test_nothing_to_go_on_with_is_said(
    arguments: list[str], said: str, logged: bool, tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(yaml.safe_dump(PROTOCOL))
    Path("setup.yaml").write_text(yaml.safe_dump(SETUP))
    t_s = np.arange(0.0, 2.0, 0.01)
    write_readings(tmp_path / "r.csv", [ReadingBlock(t_s, np.ones((200, 6)))])
    common = ["log", "--driver", "replay", "--port", "r.csv", "--out", "out"]
    if logged:
        # A log without a protocol is no bench session.
        assert run(capsys, monkeypatch, *common, "--set", "speed=0")[0] == 0
    code, text, err = run(capsys, monkeypatch, *common, *arguments)
    assert (code, text, err.count("\n")) == (2, "", 1)
    assert said in err
    assert Path("out").exists() == logged
