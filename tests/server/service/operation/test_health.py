"""Health, metrics and the log: what they say of a service, and what they keep to themselves."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families
from sqlalchemy import insert

from server.service.jobs.supervisor import Workers
from server.service.operation.health import LITTLE_BYTES, Health
from server.service.operation.migrate import expected
from server.service.operation.scrub import Scrub
from server.service.routes import health as routes
from server.service.settings import Settings
from server.service.storage.database import Database, now_utc
from server.service.storage.schema import jobs
from server.service.web import logs
from server.service.web.metrics import Metrics
from tests.server.service.asks import Answer, ask
from tests.server.service.guarded import Guarded
from tests.server.service.postgres import postgres_url


class Looked(Guarded):
    """An application with the addresses of health and metrics."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.ready = False
        self.workers = Workers(2, 1, 1, 3)
        self.health = Health(self.database, lambda: self.ready, lambda: self.workers, Scrub(self.database))
        self.health.report(self.metrics)
        self.app.state.health, self.app.state.metrics = self.health, self.metrics
        self.app.include_router(routes.router, prefix="/api/v1/of")
        self.app.include_router(routes.metrics_router)

    def ask(self, path: str) -> Answer:
        return ask(self.app, path=path)

    def metric(self, name: str, **labels: str) -> float | None:
        """A value as Prometheus reads it."""
        families = text_string_to_metric_families(self.ask("/metrics").body.decode())
        values = [s.value for f in families for s in f.samples if s.name == name and labels.items() <= s.labels.items()]
        return values[0] if values else None


@pytest.fixture
def looked(tmp_path: Path) -> Looked:
    return Looked(tmp_path)


@pytest.fixture
def log() -> Iterator[io.StringIO]:
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    yield io.StringIO()
    root.handlers[:] = before
    root.setLevel(level)
    logging.captureWarnings(capture=False)


def test_health_says_how_everything_is(looked: Looked) -> None:
    looked.ready = True
    body = looked.ask("/api/v1/of/health").json()
    assert body["schema"] == "fingertwin/health/1"
    assert (body["status"], body["live"], body["ready"], body["problems"]) == ("ok", True, True, [])
    assert body["workers"] == {"most": 2, "alive": 1, "busy": 1, "waiting": 3}
    database = body["database"]
    assert (database["dialect"], database["revision"], database["ok"]) == ("sqlite", expected(), True)
    assert database["size_bytes"] > 0
    assert database["free_bytes"] > 0
    assert body["uptime_s"] >= 0


def test_it_is_ready_only_when_it_says_so_and_live_before(looked: Looked) -> None:
    answer = looked.ask("/api/v1/of/health/ready")
    assert answer.problem["status"] == 503
    assert answer.headers["retry-after"] == "1"
    assert looked.ask("/api/v1/of/health/live").json() == {"schema": "fingertwin/live/1", "live": True}
    looked.ready = True
    assert looked.ask("/api/v1/of/health/ready").json() == {"schema": "fingertwin/ready/1", "ready": True}


def test_a_database_that_is_gone_or_a_full_disk_is_degraded_and_no_failure(
    looked: Looked, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(looked.health, "free_bytes", lambda: LITTLE_BYTES - 1)
    monkeypatch.setattr(looked.database, "alive", lambda: False)
    body = looked.ask("/api/v1/of/health").json()
    assert body["status"] == "degraded"
    assert len(body["problems"]) == 2
    assert body["database"]["ok"] is False
    assert body["database"]["size_bytes"] is None


def test_postgresql_says_its_size_and_a_lost_server_is_degraded() -> None:
    database = Database(postgres_url())
    health = Health(database, lambda: True, lambda: Workers(1, 0, 0, 0), Scrub(database))
    body = health.answer()
    assert (body.status, body.database.dialect, body.database.free_bytes) == ("ok", "postgresql", None)
    assert (body.database.size_bytes or 0) > 1e6
    database.close()
    gone = Database("postgresql+psycopg://a@127.0.0.1:1/b")
    lost = Health(gone, lambda: True, lambda: Workers(1, 0, 0, 0), Scrub(gone))
    assert lost.answer().status == "degraded"
    assert lost.jobs_by_state() == {}


def test_metrics_count_by_template_method_and_status(looked: Looked) -> None:
    for name in ("a", "b", "c"):
        looked.ask(f"/api/v1/things/{name}")
    looked.ask("/nothing/at/all")
    ask(looked.app, "BREW", "/api/v1/things")
    route = "/api/v1/things/{name}"
    assert looked.metric("fingertwin_requests_total", route=route, method="GET", status="200") == 3
    assert looked.metric("fingertwin_request_seconds_count", route=route) == 3
    assert looked.metric("fingertwin_requests_total", route="other", status="404") == 1
    assert looked.metric("fingertwin_requests_total", method="other") == 1
    assert not any(name in looked.ask("/metrics").body for name in (b"/nothing", b"BREW", b"things/a"))


def test_metrics_tell_jobs_ingest_database_and_process(looked: Looked) -> None:
    with looked.database.writing() as connection:
        for number, state in enumerate(["queued", "queued", "done"]):
            row = {"id": str(number), "number": number, "kind": "fit", "request": {}, "state": state}
            connection.execute(insert(jobs).values(row | {"timeout_s": 1.0, "created_utc": now_utc()}))
    looked.metrics.ingested(70, 6_500)
    looked.metrics.ingested(5, 900)
    looked.metrics.live_clients.inc()
    looked.metrics.ask("fingertwin_samples_total", "Samples stored.", lambda: 800.0)
    looked.metrics.ask("fingertwin_unknown", "Not known now.", lambda: None)
    assert looked.metric("fingertwin_jobs", state="queued") == 2
    assert looked.metric("fingertwin_jobs", state="done") == 1
    assert looked.metric("fingertwin_samples_total") == 800
    assert looked.metric("fingertwin_ingest_chunks_total") == 2
    assert looked.metric("fingertwin_ingest_samples_total") == 75
    assert looked.metric("fingertwin_ingest_bytes_total") == 7_400
    assert looked.metric("fingertwin_live_clients") == 1
    assert looked.metric("fingertwin_unknown") is None
    assert b"# TYPE fingertwin_samples_total counter" in looked.ask("/metrics").body
    assert (looked.metric("fingertwin_database_bytes") or 0) > 0
    assert looked.metric("fingertwin_workers", state="busy") == 1
    assert looked.ask("/metrics").headers["content-type"].startswith("text/plain; version=0.0.4")


def test_two_services_in_one_process_count_apart() -> None:
    one, other = Metrics(), Metrics()
    one.answered("GET", "/a", 200, 0.01)
    assert b'fingertwin_requests_total{method="GET",route="/a",status="200"} 1.0' in one.text()
    assert b'route="/a"' not in other.text()


def test_a_line_of_the_log_names_its_request_and_holds_no_secret(looked: Looked, log: io.StringIO) -> None:
    logs.configure(Settings(log_format="json"), log)
    token = looked.token("write")
    headers = {"authorization": f"Bearer {token}", "x-request-id": "bench-7.1", "content-length": "6"}
    answer = ask(looked.app, "POST", headers=headers, body=[b"secret"], query=b"key=" + token.encode())
    assert answer.headers["x-request-id"] == "bench-7.1"
    line = json.loads(log.getvalue().splitlines()[-1])
    assert line["request_id"] == "bench-7.1"
    assert (line["method"], line["route"], line["status"]) == ("POST", "/api/v1/things", 200)
    assert line["ms"] >= 0
    assert line["level"] == "INFO"
    logging.getLogger("other").warning("somebody sent %s", token)
    ask(looked.app, path="/api/v1/broken")
    assert "ZeroDivisionError" in log.getvalue()
    assert token not in log.getvalue()
    assert "secret" not in log.getvalue().replace("secret of ours", "")
    for text in log.getvalue().splitlines():
        json.loads(text)


def test_a_client_cannot_write_lines_of_its_own(looked: Looked, log: io.StringIO) -> None:
    logs.configure(Settings(), log)
    answer = ask(looked.app, path="/api/v1/things/a\n2026 ERROR\x1b[2J", headers={"x-request-id": "a b\n"})
    assert answer.headers["x-request-id"] != "a b\n"
    assert len(log.getvalue().splitlines()) == 1
    assert "\x1b" not in log.getvalue()


def test_what_comes_many_times_a_second_is_not_told_at_info(looked: Looked, log: io.StringIO) -> None:
    logs.configure(Settings(), log)
    looked.ask("/metrics")
    looked.ask("/api/v1/of/health")
    assert log.getvalue() == ""
    looked.ask("/api/v1/of/health/ready")
    assert " WARNING " in log.getvalue()


def test_values_of_a_databases_error_stay_out_of_the_log() -> None:
    said = "(psycopg.Error) no\n[SQL: INSERT]\n[parameters: {'body': 'somebody'}]\nbackground"
    assert "somebody" not in logs.cleaned(said)
    assert "background" in logs.cleaned(said)
