"""What hangs now: the bench's own force before it is confirmed, and nothing of validation cases before the end."""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.blocks import Chunk
from daq.bench.forces import Predict
from daq.bench.record import BenchSetup
from daq.bench.run import BenchRun
from daq.journal.rows import Event
from daq.recordings.plateaus import Plateau, reduce_window
from daq.recordings.windows import Span
from daq.sessions.models import LoadCase
from server.service.live.estimate import Predictions, SessionEstimate
from server.service.live.estimates import Estimates
from server.service.live.traces import rows_of_chunk
from server.service.storage.messages import Message, Messages
from tests.daq.bench_plays import Bench, Line, case, hung, load, predicted, setup, tared, truth, wait, whole
from tests.server.service.live_sockets import PATIENCE_S, hub_of, keep, messages_in

STREAM = "a"
Told = dict[str, Any]


class Now(Executor):
    """Computes at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        out: Future[Any] = Future()
        try:
            out.set_result(fn(*args, **kwargs))
        except Exception as error:
            out.set_exception(error)
        return out


class Spy:
    """Predicts as the tests' finger does, and remembers what it was asked."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.asked: list[LoadCase] = []

    def make(self, known: BenchSetup) -> Predict:
        self.told += [c.role for c in known.cases()]

        def predict(asked: LoadCase) -> Any:
            self.asked.append(asked)
            return predicted(asked)

        return predict


class WatchedRun(BenchRun):
    """A bench whose readings are shown live."""

    seen: Callable[[Chunk], None]

    def take(self, chunk: Chunk) -> tuple[Event, ...]:
        self.seen(chunk)
        return super().take(chunk)


class Watched(Bench):
    """A bench that a service follows: what it estimated, after each chunk."""

    def __init__(self, follow: SessionEstimate, run_setup: BenchSetup | None = None) -> None:
        self.follow = follow
        self.estimates: list[Told] = []
        run = WatchedRun(run_setup or setup(), None, STREAM)
        run.seen = self._see
        super().__init__(run)

    def of(self, name: str) -> list[Told]:
        return [e for e in self.estimates if e["case"] == name]

    def _see(self, chunk: Chunk) -> None:
        self.follow.trace(STREAM, rows_of_chunk(chunk))
        found = self.follow.estimate()
        if found is not None:
            self.estimates.append(found)

    def _keep(self, events: Sequence[Event]) -> None:
        super()._keep(events)
        for event in events:
            self.follow.event(event)


def followed(spy: Spy | None = None, tares: Any = None) -> SessionEstimate:
    return SessionEstimate("S1", Predictions(None if spy is None else spy.make, Now()), tares)


def test_the_estimate_becomes_the_force_that_the_bench_measures() -> None:
    spy = Spy()
    bench = Watched(followed(spy)).play(whole())
    measured = {v["case"]: v for v in bench.values("measured")}
    assert sorted({e["case"] for e in bench.estimates}) == ["c001", "c002", "c003", "c004"]
    for name, value in measured.items():
        estimates = bench.of(name)
        steady = [e for e in estimates if e["steady"]]
        assert steady
        assert not estimates[0]["steady"]
        assert all(e["why"] for e in estimates if not e["steady"])
        last = steady[-1]
        assert last["why"] == ""
        # Measured with the tare that follows, too.
        spread = 4.0 * np.array(last["sd_N"]) + 0.01
        assert (np.abs(np.array(last["force_N"]) - value["force_N"]) < spread).all()
        assert 0.1 < np.linalg.norm(last["sd_N"]) / np.linalg.norm(value["sd_N"]) < 10.0
    # What hung before is not shown as what hangs now.
    assert all(e["window_s"][0] >= b.at_s for b in bench.said if b.kind == "loaded" for e in bench.of(b.value["step"]))


def test_validation_cases_are_estimated_and_the_model_is_never_asked_about_them() -> None:
    spy = Spy()
    bench = Watched(followed(spy)).play(whole())
    assert set(spy.told) == {"identification"}
    assert {c.role for c in spy.asked} == {"identification"}
    hidden = bench.of("c003")
    assert any(e["steady"] for e in hidden)
    for e in hidden:
        assert (e["role"], e["prediction"]) == ("validation", "hidden")
        assert e["predicted_N"] is e["band_N"] is e["outside"] is None
    for name, location, masses in (("c001", "tip", {"FDP": 950.0}), ("c004", "bone", {"FDP": 950.0})):
        last = bench.of(name)[-1]
        assert last["prediction"] == "given"
        assert last["predicted_N"] == pytest.approx(truth(location, masses)[:3], abs=1e-6)
        assert (last["band_N"], last["outside"], last["doubts"]) == ([0.5] * 3, False, [])


def test_a_wrong_weight_is_seen_while_it_hangs_and_of_a_validation_case_only_what_the_weights_say() -> None:
    spy = Spy()
    wrong = truth("tip", {"FDP": 300})
    bench = Watched(followed(spy)).play([*tared(), "next", *tared(), load(wrong), wait(0.3), "loaded", wait(5.0)])
    last = bench.estimates[-1]
    assert (last["case"], last["steady"], last["outside"]) == ("c001", True, True)
    assert "wrong weight" in last["doubts"][0]
    # A validation case with forces that the model would find impossible, and that its weights could make.
    skipped: list[Line] = ["next", "next", "posture_set", *tared(), load(-truth("tip", {"FDP": 400})), wait(0.3)]
    last = bench.play([*skipped, "loaded", wait(5.0)]).estimates[-1]
    assert (last["case"], last["steady"], last["outside"], last["doubts"]) == ("c003", True, None, [])
    assert {c.role for c in spy.asked} == {"identification"}


def test_what_creeps_or_slips_is_not_steady_and_says_why() -> None:
    bench = Watched(followed())
    bench.play([*tared(), "next", *tared()])
    steps: list[Line] = [load(truth("tip", {"FDP": 950})), wait(0.3), "loaded"]
    for k in range(40):
        steps += [load(truth("tip", {"FDP": 950 - 6 * k})), wait(0.25)]
    bench.play(steps)
    assert not any(e["steady"] for e in bench.estimates)
    assert any("creeps" in e["why"] for e in bench.estimates)
    moving = [e["force_N"][1] for e in bench.estimates if e["force_N"]]
    assert moving[-1] - moving[0] > 0.3
    assert bench.estimates[-1]["prediction"] == "none"


def test_nothing_is_estimated_without_a_case_that_hangs_and_a_tare_in_force() -> None:
    bench = Watched(followed(Spy()))
    weight = [*tared(), *hung(np.array([0.0, -4.905, 0.0, 0.0, 0.0, 0.0]))]
    bench.play([*weight, wait(2.0), "next", *tared(), wait(1.0)])
    assert bench.estimates == []
    bench.play([load(truth("tip", {"FDP": 950})), wait(0.3), "loaded", wait(3.0)])
    seen = len(bench.estimates)
    assert seen > 0
    bench.play(["slipped", wait(3.0)])
    assert len(bench.estimates) == seen
    # No new reading, no new estimate.
    assert bench.follow.estimate() is None


def test_a_repeat_is_predicted_as_what_it_repeats() -> None:
    bench = Watched(followed(Spy()))
    bench.play([*tared(), "next", *tared(), *case("tip", FDP=950), *tared(), "repeat", *case("tip", FDP=950)])
    again = bench.of("c001r1")
    assert again[-1]["predicted_N"] == bench.of("c001")[-1]["predicted_N"] is not None


def test_a_model_that_fails_or_is_not_ready_leaves_the_force() -> None:
    def broken(_: BenchSetup) -> Predict:
        raise ValueError("no such finger")

    script: list[Line] = [*tared(), "next", *tared(), load(truth("tip", {"FDP": 950})), wait(0.3), "loaded", wait(5.0)]
    failing = Watched(SessionEstimate("S1", Predictions(broken, Now()))).play(script).estimates[-1]
    assert (failing["prediction"], failing["predicted_N"], failing["steady"]) == ("failed", None, True)
    assert "no such finger" in failing["doubts"][0]

    class Later(Executor):
        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            return Future()

    late = Watched(SessionEstimate("S1", Predictions(Spy().make, Later()))).play(script).estimates[-1]
    assert (late["prediction"], late["predicted_N"], late["steady"]) == ("pending", None, True)
    assert late["force_N"] == failing["force_N"]


def test_one_setup_is_computed_once() -> None:
    spy = Spy()
    predictions = Predictions(spy.make, Now())
    futures = [predictions.of(setup()) for _ in range(3)]
    assert futures[0] is futures[1] is futures[2] is not None
    other = predictions.of(setup(gravity_m_s2=9.80))
    assert other is not futures[0]
    assert spy.told == ["identification"] * 6


# ----- several benches, through messages


def body(event: Event, number: int) -> Told:
    return {"stream": event.stream, "at_s": event.at_s, "utc_s": 0.0, "kind": event.kind, "value": dict(event.value),
            "epoch": "e", "number": number}  # fmt: skip


class Recorded(Bench):
    """A bench whose events are kept as messages, and whose chunks are."""

    def __init__(self, messages: Messages, session: str) -> None:
        self.messages, self.session = messages, session
        self.chunks: list[Chunk] = []
        self.log: list[Chunk | Event] = []
        run = WatchedRun(setup(), None, STREAM)
        run.seen = self._see
        super().__init__(run)

    def _see(self, chunk: Chunk) -> None:
        self.chunks.append(chunk)
        self.log.append(chunk)

    def stored(self, session: str, stream: str | None, window_s: Span) -> Plateau | None:
        t = np.concatenate([c.t_s for c in self.chunks])
        inside = (t >= window_s[0]) & (t < window_s[1])
        return reduce_window(t[inside], np.concatenate([c.wrench for c in self.chunks])[inside])

    def _keep(self, events: Sequence[Event]) -> None:
        super()._keep(events)
        self.log += events
        for event in events:
            keep(self.messages, "event", self.session, **body(event, len(self.said)))


HANGING: list[Line] = [*tared(), "next", *tared(), load(truth("tip", {"FDP": 950})), wait(0.3), "loaded", wait(5.0)]


def test_a_service_that_restarts_while_a_weight_hangs_goes_on_estimating(tmp_path: Path) -> None:
    messages = messages_in(tmp_path)
    bench = Recorded(messages, "S")
    bench.play(HANGING)
    before = len(bench.chunks)
    bench.play([wait(5.0)])
    # The service sees only what comes after its start.
    later = [("S", STREAM, rows_of_chunk(c)) for c in bench.chunks[before:]]
    estimates = Estimates(lambda _: None, messages, Spy().make, bench.stored)
    out = [found for item in later for _, found in estimates.step([item])]
    assert out[-1]["case"] == "c001"
    assert out[-1]["steady"]
    assert out[-1]["force_N"] == pytest.approx(truth("tip", {"FDP": 950})[:3], abs=0.02)
    without = Estimates(lambda _: None, messages, None, None)
    waiting = [found for item in later for _, found in without.step([item])][-1]
    assert (waiting["force_N"], waiting["why"]) == (None, "the tare's readings are not here yet")
    for one in (estimates, without):
        one.close()


def test_what_is_wrong_with_one_bench_is_no_others_concern(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    messages = messages_in(tmp_path)
    keep(messages, "event", "broken", kind="bench_started", at_s=0.0, value={"id": 3}, stream=None)
    keep(messages, "event", "odd", kind=None, at_s="soon")
    bench = Recorded(messages, "S")
    bench.play(HANGING)
    estimates = Estimates(lambda _: None, messages, None, bench.stored)
    out = []
    for chunk in bench.chunks:
        rows = rows_of_chunk(chunk)
        out += estimates.step([(name, STREAM, rows) for name in ("broken", "S", "none", "odd")])
    assert {session for session, _ in out} == {"S"}
    assert "session broken" in caplog.text
    assert "session odd" in caplog.text
    estimates.close()


def test_an_event_counts_once_whether_it_was_stored_before_or_told_now(tmp_path: Path) -> None:
    messages = messages_in(tmp_path)
    bench = Recorded(messages, "S")
    bench.play([*tared(), "next", *tared()])
    stored = messages.after(0, "S")
    estimates = Estimates(lambda _: None, messages, None, None)
    for chunk in bench.chunks:
        estimates.step([("S", STREAM, rows_of_chunk(chunk))])
    # Were the bench begun again by what is told again, it would know no reading of its tare.
    estimates.step([*stored])
    first = len(bench.chunks)
    bench.play([load(truth("tip", {"FDP": 950})), wait(0.3), "loaded", wait(5.0)])
    new = [m for m in messages.after(0, "S") if m.id is not None and m.id > (stored[-1].id or 0)]
    given: list[Any] = [*new, *(("S", STREAM, rows_of_chunk(c)) for c in bench.chunks[first:])]
    assert estimates.step(given)[0][1]["force_N"] == pytest.approx(truth("tip", {"FDP": 950})[:3], abs=0.02)
    estimates.close()


def test_what_is_taken_at_once_is_taken_in_order(tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    bench = Recorded(messages_in(tmp_path), "S")
    bench.play(HANGING)
    given: list[Any] = [
        Message("event", "S", body(item, 0), number + 1)
        if isinstance(item, Event)
        else ("S", STREAM, rows_of_chunk(item))
        for number, item in enumerate(bench.log)
    ]
    one_by_one = Estimates(lambda _: None, messages_in(tmp_path / "none"), None, None)
    at_once = Estimates(lambda _: None, messages_in(tmp_path / "none"), None, None)
    last = [found for item in given for _, found in one_by_one.step([item])][-1]
    ((_, together),) = at_once.step(given)
    assert (together["case"], together["at_s"]) == (last["case"], last["at_s"])
    assert together["force_N"] == pytest.approx(last["force_N"], abs=0.02)
    for one in (one_by_one, at_once):
        one.close()


def test_what_hangs_is_estimated_however_long_nothing_did(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("server.service.live.estimates.IDLE_S", 1e4)
    bench = Recorded(messages_in(tmp_path), "S")
    bench.play(HANGING)
    (tmp_path / "none").mkdir()
    told: queue.Queue[Message] = queue.Queue()
    estimates = Estimates(told.put, messages_in(tmp_path / "none"), None, None)
    estimates.start()
    for number, item in enumerate(bench.log):
        if isinstance(item, Event):
            estimates.event(Message("event", "S", body(item, 0), number + 1))
        else:
            estimates.trace("S", STREAM, rows_of_chunk(item))
    assert told.get(timeout=PATIENCE_S).body["case"] == "c001"
    estimates.close()


def test_estimates_reach_who_watches(tmp_path: Path) -> None:
    messages = messages_in(tmp_path)

    async def play() -> None:
        bench = Recorded(messages, "S")
        async with hub_of(messages, make_predict=Spy().make, tares=bench.stored) as served:
            mine, others, everybody = [await served.connect(*s) for s in (("S",), ("T",), ())]
            await asyncio.to_thread(bench.play, HANGING)
            for chunk in bench.chunks:
                await asyncio.to_thread(served.hub.offer_chunk, "S", STREAM, chunk)
            await mine.until(lambda: mine.told("estimate"))
            async with asyncio.timeout(PATIENCE_S):
                while not (last := mine.told("estimate")[-1])["body"]["steady"] or not last["body"]["predicted_N"]:
                    first = len(bench.chunks)
                    bench.play([wait(0.5)])
                    for chunk in bench.chunks[first:]:
                        served.hub.offer_chunk("S", STREAM, chunk)
                    await asyncio.sleep(0.05)
            await everybody.until(lambda: everybody.told("estimate"))
            assert (last["session"], last["body"]["case"], last["body"]["prediction"]) == ("S", "c001", "given")
            assert others.told("estimate") == []
            assert "id" not in last
            assert everybody.told("trace") == []

    asyncio.run(play())
