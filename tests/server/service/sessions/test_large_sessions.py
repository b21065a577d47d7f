"""Sessions of very many load cases: what they cost grows with their cases, not with their square."""

from __future__ import annotations

import copy
import sys
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from server.service.exports.reports import checked
from server.service.models.case_updates import case_bodies
from server.service.sessions.measuring import Measured, Measuring
from server.service.sessions.records import Edit, Record, apply_edits
from server.service.sessions.sizes import MOST_CASES, MOST_SETTINGS
from tests.daq.benches import averaged
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/sessions"
FEW, MANY = 100, 400


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield out
    out.close()


def session_of(name: str, count: int) -> dict[str, Any]:
    """Averaged forces at both mounts, every other one a repeat."""
    data = averaged() | {"id": name}
    first = data["cases"][0] | {"force_sd_N": [0.02, 0.02, 0.02]}
    cases = [
        first | {"id": f"c{i:04d}", "location": ("tip", "bone")[i % 2], "masses_g": {"FDP": 200.0 + i % 700}}
        for i in range(count)
    ]
    cases[1::2] = [c | {"repeat_of": "c0000"} for c in cases[1::2]]
    return data | {"cases": cases}


def cost(act: Callable[[], object]) -> tuple[int, int]:
    """How many functions are called, and how much memory is held at most [bytes]."""
    calls = 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    tracemalloc.start()
    sys.setprofile(count)
    try:
        act()
    finally:
        sys.setprofile(None)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return calls, peak


def test_cases_check_and_edits_cost_in_proportion_to_the_cases(service: ServiceReceiver) -> None:
    parts = service.parts

    def steps(name: str) -> dict[str, Callable[[], object]]:
        return {
            "cases": lambda: case_bodies(parts.measuring.of(name), parts.models),
            "edit": lambda: parts.sessions.edit(name, "exclude", "c0001", {"reason": "slipped"}),
            "cases after it": lambda: case_bodies(parts.measuring.of(name), parts.models),
            "check": lambda: checked(parts, name),
            "comparison": lambda: parts.models.comparison(name),
        }

    for name, count in (("warm", MANY), ("few", FEW), ("many", MANY)):
        # What is compiled for a shape, and imported late, is not counted.
        parts.sessions.create(name, session_of(name, count))
        if name == "warm":
            assert all(act() is not None for act in steps(name).values())
    assert parts.case_updates.settle(60.0)
    parts.sessions.edit("few", "exclude", "c0003", {"reason": "slipped"})
    parts.sessions.edit("many", "exclude", "c0003", {"reason": "slipped"})
    few, many = ({step: cost(act) for step, act in steps(name).items()} for name in ("few", "many"))
    for step in few:
        for small, large in zip(few[step], many[step], strict=True):
            assert large < 1.25 * MANY / FEW * small, (step, few[step], many[step])


def test_who_asks_while_a_session_is_measured_waits_for_that(
    service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure, begun, go = Measuring._measure, threading.Semaphore(0), threading.Event()

    def slowly(self: Measuring, record: Record) -> Measured:
        begun.release()
        assert go.wait(30.0)
        return measure(self, record)

    service.parts.sessions.create("asked", session_of("asked", 2))
    assert service.parts.case_updates.settle(60.0)
    service.parts.sessions.close("asked")
    measuring = Measuring(service.parts.sessions, service.parts.measuring._windows)
    monkeypatch.setattr(Measuring, "_measure", slowly)
    found: list[Measured] = []
    threads = [threading.Thread(target=lambda: found.append(measuring.of("asked"))) for _ in range(4)]
    for thread in threads:
        thread.start()
    assert begun.acquire(timeout=30.0)
    go.set()
    for thread in threads:
        thread.join(30.0)
    assert len(found) == 4
    assert len({id(f) for f in found}) == 1
    assert not begun.acquire(blocking=False), "measured more than once"


def test_edits_leave_the_document_alone() -> None:
    document = session_of("S1", 3)
    kept = copy.deepcopy(document)
    amended = {"case": "c0002", "masses_g": {"FDP": 300.0}, "why": "notes"}
    bodies: list[tuple[str, str, dict[str, Any]]] = [
        ("windows", "c0000", {"unloaded_s": [0.0, 1.0], "loaded_s": [2.0, 3.0]}),
        ("exclude", "c0001", {"reason": "slipped"}),
        ("include", "c0001", {}),
        ("case", "new", session_of("S1", 1)["cases"][0] | {"id": "new"}),
        ("amend", "c0002", {"amendments": [amended]}),
    ]
    edits = [
        Edit(n, "2026-01-01T00:00:00+00:00", "me", kind, case, body, None)
        for n, (kind, case, body) in enumerate(bodies)
    ]
    once = apply_edits(document, edits)
    assert document == kept
    assert once == apply_edits(document, edits)
    assert [c["id"] for c in once["cases"]] == ["c0000", "c0001", "c0002", "new"]
    assert [a["case"] for a in once["amendments"]] == ["c0002"]


def test_messages_of_one_transaction_are_numbered_in_their_order(service: ServiceReceiver) -> None:
    messages, heard = service.parts.messages, []
    last = messages.latest()
    messages.listen(lambda m: heard.append(m.body["n"]) if m.kind == "counted" else None)
    with messages.writing() as telling:
        telling.tell_all("counted", None, [{"n": n} for n in range(2500)])
        telling.tell_all("counted", None, [])
    kept = [m for first in (0, 1000, 2000) for m in messages.after(last + first)]
    assert [m.body["n"] for m in kept if m.kind == "counted"] == list(range(2500)) == heard


def changed(key: str, values: list[Any]) -> dict[str, Any]:
    data = session_of("S9", len(values))
    return data | {"cases": [c | {key: v} for c, v in zip(data["cases"], values, strict=True)]}


@pytest.mark.parametrize(
    ("document", "said"),
    [
        (session_of("S9", MOST_CASES + 1), f"at most {MOST_CASES}"),
        (changed("setting", list(range(MOST_SETTINGS + 1))), f"at most {MOST_SETTINGS}"),
        (changed("mounting", list(range(2 * MOST_SETTINGS + 2))), f"at most {MOST_SETTINGS}"),
    ],
)
def test_more_than_can_be_fitted_is_refused_before_it_is_kept(
    service: ServiceReceiver, document: dict[str, Any], said: str
) -> None:
    answer = service.client().post(AT, json={"id": "S9", "document": document})
    assert answer.status_code == 422
    assert said in answer.json()["detail"]
    assert service.client().get(f"{AT}/S9").status_code == 404


def test_the_most_cases_are_kept(tmp_path: Path, service: ServiceReceiver) -> None:
    data = session_of("S8", MOST_CASES)
    assert service.parts.sessions.create("S8", data)
    assert len(service.parts.sessions.read("S8").cases) == MOST_CASES
