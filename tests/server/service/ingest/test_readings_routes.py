"""Stored readings by window: no peak lost, whatever is asked for; the windows of a case; the events of a bench."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.blocks import Chunk
from daq.recordings.readings import HEADERS
from daq.sessions import read_session
from daq.signals.corrections import measure
from server.service.ingest import envelopes
from tests.daq.bench_plays import case, tared
from tests.server.service.postgres import postgres_url
from tests.server.service.recorded import STREAM, chunks_of, describe, document_of, put, upload
from tests.server.service.running import ServiceReceiver
from tests.server.service.sessions.test_bench_sessions import Played

RECORDED, AVERAGED, FAST, PART = "DEV-01", "synek2019_H01", "FAST", "PART"
AT = "/api/v1/sessions"
CHANNELS = HEADERS[1:]
RATE_HZ, SECONDS, SIZE = 1000.0, 30.0, 137


def fast() -> Chunk:
    """Half a minute at 1 kHz, with spikes of one sample and some flags."""
    t_s = 5.0 + np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    rng = np.random.default_rng(5)
    wrench = rng.normal(size=(len(t_s), 6))
    spikes = rng.integers(0, len(t_s), 40)
    wrench[spikes] *= 50.0
    status = (rng.random(len(t_s)) < 0.001).astype(np.int64)
    return Chunk(0, t_s, wrench, status, rng.random(len(t_s)) < 0.001, b"", [], 1e9)


def portions(whole: Chunk, size: int = SIZE) -> Iterator[Chunk]:
    for a in range(0, len(whole), size):
        part = slice(a, a + size)
        yield Chunk(
            a, whole.t_s[part], whole.wrench[part], whole.status[part], whole.overload[part], b"", [], whole.utc_s
        )


def begin(service: ServiceReceiver, name: str) -> None:
    service.client().post(AT, json={"id": name}).raise_for_status()
    describe(service.client(), name)


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    more = {} if request.param == "sqlite" else {"database_url": postgres_url()}
    out = ServiceReceiver(tmp_path_factory.mktemp("service"), requests_per_s=1e6, **more)
    upload(out.client(), RECORDED)
    upload(out.client(), AVERAGED)
    begin(out, FAST)
    for chunk in portions(fast()):
        put(out.client(), FAST, chunk).raise_for_status()
    yield out
    out.close()


def asked(service: ServiceReceiver, session: str, **window: Any) -> dict[str, Any]:
    answer = service.client().get(f"{AT}/{session}/readings", params=window)
    assert answer.status_code == 200, answer.text
    body: dict[str, Any] = answer.json()
    return body


@pytest.mark.parametrize("points", [2, 30, 333, 1500])
@pytest.mark.parametrize(
    "window", [{}, {"from_s": 6.0, "to_s": 27.5}, {"from_s": 11.1111, "to_s": 13.3}, {"to_s": 9.0}]
)
def test_every_reading_lies_in_one_stretch_and_no_peak_is_lost(
    service: ServiceReceiver, window: dict[str, float], points: int
) -> None:
    whole = fast()
    low, high = window.get("from_s", 0.0), window.get("to_s", 100.0)
    for _ in range(2):  # read, and remembered
        body = asked(service, FAST, points=points, **window)
        assert body["kind"] == "envelope"
        assert len(body["from_s"]) <= points
        begins, ends, counts = (np.array(body[k]) for k in ("from_s", "to_s", "count"))
        assert (begins[1:] > ends[:-1]).all()
        # A remembered row may reach a little beyond the window.
        edge_s = envelopes.FINE_S
        assert low - edge_s <= begins[0]
        assert ends[-1] <= high + edge_s
        inside = (whole.t_s >= low) & (whole.t_s <= high)
        assert inside.sum() <= body["samples"] == counts.sum() <= inside.sum() + 2 * edge_s * RATE_HZ
        flagged = whole.overload | (whole.status != 0)
        for k in range(len(begins)):
            mine = slice(*np.searchsorted(whole.t_s, [begins[k] - 1e-9, ends[k] + 1e-9]))
            assert len(whole.t_s[mine]) == counts[k]
            assert body["flagged"][k] == flagged[mine].sum()
            least, most = whole.wrench[mine].min(axis=0), whole.wrench[mine].max(axis=0)
            assert [body["least"][c][k] for c in CHANNELS] == pytest.approx(least, rel=1e-6)
            assert [body["most"][c][k] for c in CHANNELS] == pytest.approx(most, rel=1e-6)


def test_few_readings_come_as_they_are(service: ServiceReceiver) -> None:
    whole, window = fast(), {"from_s": 7.0005, "to_s": 7.0995}
    inside = (whole.t_s >= window["from_s"]) & (whole.t_s <= window["to_s"])
    body = asked(service, FAST, points=int(inside.sum()), **window)
    assert (body["kind"], body["samples"]) == ("raw", inside.sum())
    assert body["t_s"] == whole.t_s[inside].tolist()
    assert body["values"] == {c: whole.wrench[inside, i].tolist() for i, c in enumerate(CHANNELS)}
    assert asked(service, FAST, points=int(inside.sum()) - 1, **window)["kind"] == "envelope"
    assert body["stream_s"] == [whole.t_s[0], whole.t_s[-1]]


def test_a_slow_stream_is_read_as_well_as_a_fast_one(service: ServiceReceiver) -> None:
    times = np.concatenate([c.t_s for c in chunks_of(RECORDED)])
    wrench = np.concatenate([c.wrench for c in chunks_of(RECORDED)])
    body = asked(service, RECORDED, points=500)
    assert body["samples"] == len(times)
    assert len(body["from_s"]) <= 500
    for i, c in enumerate(CHANNELS):
        assert min(body["least"][c]) == pytest.approx(wrench[:, i].min(), rel=1e-6)
        assert max(body["most"][c]) == pytest.approx(wrench[:, i].max(), rel=1e-6)


def test_what_is_missing_is_told_until_it_comes(service: ServiceReceiver) -> None:
    begin(service, PART)
    parts = list(portions(fast(), 1000))
    late = parts[7]
    for chunk in (*parts[:7], *parts[8:20]):
        put(service.client(), PART, chunk).raise_for_status()
    for points in (20, 20, 10_000):
        body = asked(service, PART, points=points)
        assert body["missing_s"] == [[parts[6].t_s[-1], parts[8].t_s[0]]]
        assert body["samples"] == 19_000
    assert asked(service, PART, from_s=5.0, to_s=6.0)["missing_s"] == []
    put(service.client(), PART, late).raise_for_status()
    body = asked(service, PART, points=20)
    assert (body["missing_s"], body["samples"]) == ([], 20_000)
    for chunk in parts[20:]:
        put(service.client(), PART, chunk).raise_for_status()
    assert asked(service, PART, points=20)["samples"] == len(fast())


def test_what_is_remembered_is_bounded(service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(envelopes, "MOST_ROWS", 100)
    reader = envelopes.Envelopes(service.parts.database)
    first = reader.window(FAST, STREAM, None, None, 50).found
    again = reader.window(FAST, STREAM, None, None, 50).found
    assert isinstance(first, np.ndarray)
    assert isinstance(again, np.ndarray)
    assert first.tobytes() == again.tobytes()
    assert reader._rows <= 100 == envelopes.MOST_ROWS
    assert reader._rows == sum(len(g.rows) for g in reader._known.values())


def test_a_window_too_long_to_be_read_at_once_is_refused_until_its_parts_are_known(
    service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(envelopes, "MOST_SAMPLES", 20_000)
    service.parts.envelopes = envelopes.Envelopes(service.parts.database)
    refused = service.client().get(f"{AT}/{FAST}/readings", params={"points": 50})
    assert refused.status_code == 422
    assert "Ask for parts" in refused.json()["detail"]
    asked(service, FAST, points=50, to_s=12.0)
    assert asked(service, FAST, points=50)["samples"] == len(fast())


@pytest.mark.parametrize("name", ["c001", "c050"])
def test_the_windows_of_a_case_are_reduced_as_in_its_folder(service: ServiceReceiver, name: str) -> None:
    body = service.client().get(f"{AT}/{RECORDED}/cases/{name}/readings", params={"margin_s": 2.0}).json()
    measured = measure(read_session(RECORDED))
    expected = next(m for m in measured.cases if m.case.id == name)
    assert {w["name"]: w["window_s"] for w in body["windows"]} == {k: list(w) for k, w in expected.case.windows()}
    loaded = next(w for w in body["windows"] if w["name"] == "loaded_s")
    plateau = loaded["plateau"]
    assert expected.plateau is not None
    assert plateau["mean"] == dict(zip(CHANNELS, expected.plateau.mean, strict=True))
    assert plateau["slope_per_s"] == {
        f"{c}_per_s": v for c, v in zip(CHANNELS, expected.plateau.slope_per_s, strict=True)
    }
    assert list(plateau["sd_of_mean"].values()) == np.sqrt(np.diag(expected.plateau.covariance)).tolist()
    assert list(plateau["effective"].values()) == expected.plateau.effective.tolist()
    assert plateau["steady"] == expected.plateau.steady
    times = np.array(loaded["readings"]["t_s"])
    low, high = loaded["window_s"]
    assert low - 2.0 <= times[0] < low < high < times[-1] <= high + 2.0
    assert ((times >= low) & (times <= high)).sum() == plateau["readings"]


def test_windows_that_wait_or_cannot_be_reduced_say_so(tmp_path: Path) -> None:
    service = ServiceReceiver(tmp_path)
    document = document_of(RECORDED)
    cases = [c | {"unloaded_s": [0.4, 3.8]} for c in document["cases"][:2]]
    cases[0]["loaded_s"], cases[1]["loaded_s"] = [9000.0, 9003.0], [9.6, 9.63]
    body = document | {"id": "WAITS", "cases": cases}
    service.client().post(AT, json={"id": "WAITS", "document": body}).raise_for_status()
    describe(service.client(), "WAITS")
    for chunk in list(chunks_of(RECORDED))[:5]:
        put(service.client(), "WAITS", chunk).raise_for_status()
    for found, state, words in ((cases[0], "waiting", "to come"), (cases[1], "failed", "at least")):
        rows = service.client().get(f"{AT}/WAITS/cases/{found['id']}/readings").json()["windows"]
        loaded = next(w for w in rows if w["name"] == "loaded_s")
        assert (loaded["state"], loaded["plateau"]) == (state, None)
        assert words in loaded["why"]
    service.close()


def test_a_case_that_turns_out_to_be_unusable_says_so_once_its_readings_are_there(tmp_path: Path) -> None:
    service = ServiceReceiver(tmp_path)
    document = document_of(RECORDED)
    cases = [c | {"unloaded_s": [0.4, 3.8]} for c in document["cases"][:2]]
    cases[1]["loaded_s"] = [9.6, 9.63]
    body = document | {"id": "LATE", "cases": cases}
    service.client().post(AT, json={"id": "LATE", "document": body}).raise_for_status()
    describe(service.client(), "LATE")

    def seen() -> list[tuple[str, str]]:
        found = service.client().get(f"{AT}/LATE/cases").json()["cases"]
        return [(c["state"], "few" if "at least" in c["why"] else c["why"].split(" ")[0]) for c in found]

    assert seen() == [("waiting", "readings"), ("waiting", "readings")]
    chunks = list(portions(next(iter(chunks_of(RECORDED))), 100))
    put(service.client(), "LATE", chunks[0]).raise_for_status()
    assert seen() == [("waiting", "readings"), ("waiting", "readings")]
    for chunk in chunks[1:]:
        put(service.client(), "LATE", chunk).raise_for_status()
    assert seen() == [("measured", ""), ("failed", "few")]
    assert service.parts.case_updates.settle(60.0)
    told = [(m.body["id"], m.body["state"]) for m in service.parts.messages.after(0) if m.kind == "case"]
    assert sorted(told) == [(cases[0]["id"], "measured"), (cases[1]["id"], "failed")]
    service.close()


def test_events_come_as_they_were_sent_page_by_page(tmp_path: Path) -> None:
    played = Played(tmp_path)
    played.bench.play(["next", *tared(), *case("tip", FDP=950)])
    played.send()
    assert played.bench.journal is not None
    rows: list[dict[str, Any]] = []
    after = 0
    while True:
        page = played.client.get(f"{AT}/S1/events", params={"limit": 3, "after": after}).json()
        rows += page["events"]
        assert len(page["events"]) <= 3
        if page["next"] is None:
            break
        after = page["next"]
    assert [(r["kind"], r["value"]) for r in rows] == [
        (e.kind, json.loads(json.dumps(dict(e.value)))) for e in played.bench.said
    ]
    assert [r["number"] for r in rows] == list(range(len(rows)))
    tares = played.client.get(f"{AT}/S1/events", params={"kind": "tare"}).json()
    assert tares["events"] == [r for r in rows if r["kind"] == "tare"] != []
    assert played.client.get(f"{AT}/S1/events", params={"kind": "earthquake"}).json()["events"] == []
    played.bench.journal.close()
    played.service.close()


@pytest.mark.parametrize(
    ("path", "params", "status", "words"),
    [
        ("/nobody/readings", {}, 404, "nobody"),
        (f"/{AVERAGED}/readings", {}, 409, "no readings"),
        (f"/{RECORDED}/readings", {"stream": "../db"}, 404, "../db"),
        (f"/{RECORDED}/readings", {"from_s": "nan"}, 422, "finite"),
        (f"/{RECORDED}/readings", {"to_s": "inf"}, 422, "to_s"),
        (f"/{RECORDED}/readings", {"from_s": "soon"}, 422, "number"),
        (f"/{RECORDED}/readings", {"from_s": 9.0, "to_s": 3.0}, 422, "from_s before to_s"),
        (f"/{RECORDED}/readings", {"points": 10**12}, 422, "10000"),
        (f"/{RECORDED}/readings", {"points": 0}, 422, "points"),
        (f"/{RECORDED}/cases/c999/readings", {}, 404, "c999"),
        (f"/{RECORDED}/cases/c001/readings", {"margin_s": -1.0}, 422, "margin_s"),
        ("/nobody/cases/c001/readings", {}, 404, "nobody"),
        ("/nobody/events", {}, 404, "nobody"),
        (f"/{RECORDED}/events", {"after": -1}, 422, "after"),
        (f"/{RECORDED}/events", {"limit": 10**6}, 422, "limit"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(
    service: ServiceReceiver, path: str, params: dict[str, Any], status: int, words: str
) -> None:
    answer = service.client().get(f"{AT}{path}", params=params)
    assert answer.status_code == status
    assert answer.headers["Content-Type"].startswith("application/problem+json")
    assert words in answer.json()["detail"]


def test_a_case_without_windows_and_a_window_beyond_the_stream_have_nothing_to_show(service: ServiceReceiver) -> None:
    name = document_of(AVERAGED)["cases"][0]["id"]
    answer = service.client().get(f"{AT}/{AVERAGED}/cases/{name}/readings")
    assert answer.status_code == 409
    assert "no windows" in answer.json()["detail"]
    body = asked(service, RECORDED, from_s=1e6)
    assert (body["samples"], body["t_s"], body["missing_s"]) == (0, [], [])
    begin(service, "NOTHING")
    assert asked(service, "NOTHING")["stream_s"] is None
