"""Traces: an envelope of envelopes is the envelope, at any rate; no peak is lost, and nothing is shown twice."""

from __future__ import annotations

from typing import Any

import httpx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from daq.acquisition.blocks import Chunk
from daq.uplink.live_tail import LiveTail
from server.service.live.bodies import LiveMessage
from server.service.live.traces import (
    ENVELOPE,
    IDLE_S,
    MOST_STREAMS,
    RECENT_BIN_S,
    RECENT_S,
    Rows,
    Trace,
    Traces,
    decimated,
    merged,
    rows_of,
    rows_of_chunk,
)  # fmt: skip

Floats = NDArray[np.float64]

readings = st.lists(
    st.tuples(st.floats(-30.0, 30.0) | st.just(np.nan), st.booleans()), min_size=1, max_size=120
).map(lambda pairs: (np.array([v for v, _ in pairs]), np.array([o for _, o in pairs])))  # fmt: skip


def chunk_of(
    values: Floats, overload: NDArray[np.bool_] | None = None, start_s: float = 0.0, step_s: float = 0.003
) -> Chunk:
    n = len(values)
    wrench = values[:, None] * np.arange(1.0, 7.0)
    over = np.zeros(n, bool) if overload is None else overload
    return Chunk(0, start_s + step_s * np.arange(float(n)), wrench, np.zeros(n, np.int64), over, b"", (), 0.0)


def envelope_of(values: Floats, overload: NDArray[np.bool_], t_s: Floats) -> dict[str, Any]:
    """What one envelope must say of all readings."""
    wrench = values[:, None] * np.arange(1.0, 7.0)
    return {
        "from_s": t_s[0], "to_s": t_s[-1], "count": len(values), "latest": wrench[-1], "overload": overload.any(),
        "least": np.fmin.reduce(wrench), "most": np.fmax.reduce(wrench),
    }  # fmt: skip


def whole(rows: Rows) -> Any:
    return merged(rows, np.zeros(1, dtype=np.intp))[0]


@given(readings, st.data())
def test_the_envelope_of_envelopes_is_the_envelope(
    given: tuple[Floats, NDArray[np.bool_]], data: st.DataObject
) -> None:
    values, overload = given
    chunk = chunk_of(values, overload)
    rows, wanted = rows_of_chunk(chunk), envelope_of(values, overload, chunk.t_s)
    for _ in range(3):
        assert all(np.array_equal(whole(rows)[k], v, equal_nan=True) for k, v in wanted.items())
        if np.isfinite(values).all():
            assert np.allclose(whole(rows)["mean"], chunk.wrench.mean(axis=0), rtol=1e-9, atol=1e-9)
        cuts = data.draw(st.sets(st.integers(1, len(rows) - 1))) if len(rows) > 1 else set()
        rows = merged(rows, np.array([0, *sorted(cuts)], dtype=np.intp))


@given(readings, st.floats(1.0, 60.0), st.integers(1, 20))
def test_no_rate_loses_a_peak(given: tuple[Floats, NDArray[np.bool_]], rate_hz: float, most: int) -> None:
    rows = rows_of_chunk(chunk_of(*given, step_s=0.017))
    out = decimated(rows, rate_hz, most)
    span_s = float(rows["to_s"][-1] - rows["from_s"][0])
    assert 1 <= len(out) <= max(1, min(most, round(span_s * rate_hz)))
    assert np.array_equal(np.fmin.reduce(out["least"]), np.fmin.reduce(rows["least"]), equal_nan=True)
    assert np.array_equal(np.fmax.reduce(out["most"]), np.fmax.reduce(rows["most"]), equal_nan=True)
    assert out["count"].sum() == rows["count"].sum() == len(given[0])
    assert out["overload"].any() == rows["overload"].any()
    # In order, none beside the other.
    assert (out["from_s"][1:] > out["to_s"][:-1]).all()


def test_what_a_bench_posts_is_what_its_readings_are() -> None:
    rng = np.random.default_rng(1)
    t_s = np.arange(1400) / 7000.0
    wrench = rng.normal(size=(1400, 6))
    wrench[3, 2] = np.nan
    now = [0.0]
    bodies: list[bytes] = []

    def taken(request: httpx.Request) -> httpx.Response:
        bodies.append(request.read())
        return httpx.Response(202)

    tail = LiveTail("http://s", "S", client=httpx.Client(base_url="http://s", transport=httpx.MockTransport(taken)),
                    clock=lambda: now[0])  # fmt: skip
    for k in range(0, 1400, 40):
        now[0] = t_s[k]
        tail.offer("a", t_s[k : k + 40], wrench[k : k + 40], np.full(len(t_s[k : k + 40]), k == 80))
    now[0] += 1.0
    assert tail.post(tail.take())
    tail.stop()
    rows = rows_of(LiveMessage.model_validate_json(bodies[0]))["a"]
    assert len(rows) > 3
    one = whole(rows)
    assert (one["count"], one["from_s"], one["to_s"], one["overload"]) == (1400, t_s[0], t_s[-1], True)
    assert np.array_equal(one["least"], np.nanmin(wrench, axis=0))
    assert np.array_equal(one["most"], np.nanmax(wrench, axis=0))
    # Envelopes count readings, not components: where some are no numbers the mean is only near.
    assert np.allclose(one["mean"], np.nanmean(wrench, axis=0), atol=1e-3)
    assert np.allclose(one["mean"][3:], wrench[:, 3:].mean(axis=0), rtol=1e-12)


def envelope(**changes: Any) -> dict[str, Any]:
    six = [0.0] * 6
    return {
        "stream": "a", "from_s": 0.0, "to_s": 0.1, "count": 3, "latest": six, "least": six, "most": six,
        "overload": False,
    } | changes  # fmt: skip


@pytest.mark.parametrize(
    "wrong",
    [
        {"stream": ""}, {"stream": "a" * 101}, {"from_s": 0.2}, {"to_s": float("nan")}, {"to_s": 1e300}, {"count": 0},
        {"count": 1 << 40}, {"count": "3"}, {"latest": [0.0] * 5}, {"least": [float("inf")] * 6}, {"least": [1.0] * 6},
        {"most": "high"}, {"overload": 1},
    ],
)  # fmt: skip
def test_what_is_no_envelope_is_refused(wrong: dict[str, Any]) -> None:
    LiveMessage.model_validate({"dropped": 0, "envelopes": [envelope()]})
    with pytest.raises(ValidationError):
        LiveMessage.model_validate({"dropped": 0, "envelopes": [envelope(**wrong)]})


def test_what_is_no_number_and_a_mean_that_is_missing_find_their_places_in_a_row() -> None:
    latest, most = [1.0, None, 3.0, 4.0, 5.0, 6.0], [7.0] * 6
    given = envelope(latest=latest, most=most, overload=True)
    other = envelope(stream="b", mean=[9.0] * 6)
    found = rows_of(LiveMessage.model_validate({"dropped": 0, "envelopes": [given, other, given]}))
    assert {stream: len(rows) for stream, rows in found.items()} == {"a": 2, "b": 1}
    for row in found["a"]:
        assert np.array_equal(row["latest"], [1.0, np.nan, 3.0, 4.0, 5.0, 6.0], equal_nan=True)
        assert np.array_equal(row["mean"], row["latest"], equal_nan=True)
        assert (row["from_s"], row["to_s"], row["count"], bool(row["overload"])) == (0.0, 0.1, 3, True)
        assert (row["least"].tolist(), row["most"].tolist()) == ([0.0] * 6, most)
    assert found["b"]["mean"][0].tolist() == [9.0] * 6
    assert not found["b"]["overload"][0]


def rows(from_s: float, to_s: float, value: float = 0.0) -> Rows:
    out = np.zeros(1, ENVELOPE)
    out["from_s"], out["to_s"], out["count"] = from_s, to_s, 1
    for name in ("least", "most", "latest", "mean"):
        out[name] = value
    return out


def test_stored_chunks_show_only_what_the_live_path_has_not_shown() -> None:
    trace = Trace()
    assert len(trace.add(rows(0.0, 1.0), 0.0)) == 1
    assert len(trace.add(rows(0.2, 0.9), 0.0, live=False)) == 0
    assert trace.shown_s == 1.0
    later = rows_of_chunk(chunk_of(np.arange(1000.0), start_s=0.0), after_s=trace.shown_s)
    assert later["from_s"][0] > 1.0
    assert later["count"].sum() == 1000 - 334
    assert len(trace.add(later, 0.0, live=False)) == len(later)
    # What the live path brings too late was shown.
    assert len(trace.add(rows(1.2, 1.3), 0.0)) == 0
    assert len(rows_of_chunk(chunk_of(np.arange(10.0)), after_s=5.0)) == 0


def test_a_time_that_begins_anew_is_shown_and_stored_chunks_never_begin_one() -> None:
    trace = Trace()
    trace.add(rows(100.0, 101.0, 5.0), 0.0)
    assert len(trace.add(rows(0.0, 0.1), 0.0, live=False)) == 0
    assert len(trace.add(rows(0.0, 0.1), 0.0)) == 1
    assert trace.recent()["most"].max() == 0.0
    assert trace.shown_s == pytest.approx(0.1)


@settings(max_examples=10)
@given(st.lists(st.integers(0, 9999), min_size=1, max_size=5), st.floats(0.011, 0.4))
def test_the_last_minutes_hold_every_peak_and_no_more(peaks: list[int], step_s: float) -> None:
    trace, n = Trace(), 10_000
    values = np.zeros(n)
    values[peaks] = np.arange(1.0, len(peaks) + 1.0)
    table = np.zeros(n, ENVELOPE)
    table["from_s"] = np.arange(n) * step_s
    table["to_s"], table["count"] = table["from_s"] + 0.9 * step_s, 1
    table["most"] = values[:, None]
    for k in range(0, n, 7):
        trace.add(table[k : k + 7], 0.0)
    recent = trace.recent()
    last_s = float(table["to_s"][-1])
    inside = table["from_s"] > last_s - RECENT_S
    assert recent["most"].max() >= values[inside].max()
    for value in values[inside][values[inside] > 0.0]:
        at = float(table["from_s"][values == value][0])
        row = recent[(recent["from_s"] <= at) & (recent["to_s"] >= at)]
        assert row["most"].max() >= value
    assert (np.diff(recent["from_s"]) > 0.0).all()
    assert recent["count"].sum() == (table["from_s"] >= recent["from_s"][0]).sum()
    assert len(recent) <= (RECENT_S + 130 * 0.4) / RECENT_BIN_S + 130


def test_a_chunk_of_readings_that_are_none_shows_nothing_and_hides_nothing_after_it() -> None:
    chunk = chunk_of(np.array([1.0, np.inf, -1e300, np.nan, 2.0]))
    chunk.t_s[:] = [0.0, 0.01, np.nan, np.inf, 0.015]
    (row,) = rows_of_chunk(chunk)
    assert (row["count"], row["to_s"], row["most"][0], row["mean"][0]) == (3, 0.015, 2.0, 1.5)


def test_streams_that_say_nothing_are_let_go() -> None:
    traces = Traces()
    for k in range(MOST_STREAMS + 10):
        traces.add("S", f"{k}", rows(0.0, 1.0), now_s=float(k))
    assert len(traces) == MOST_STREAMS
    assert traces.shown_s("S", "0") == -np.inf
    assert next(s for _, s, _ in traces.of(frozenset({"S"}))) == "10"
    assert list(traces.of(frozenset({"T"}))) == []
    traces.let_go(IDLE_S + 20.5)
    assert len(traces) == MOST_STREAMS + 10 - 21
