"""Metrics for Prometheus: requests, ingest, jobs, live clients, the database, the process."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_METHODS = frozenset({"GET", "HEAD", "PUT", "POST", "PATCH", "DELETE", "OPTIONS"})
# From a single prediction to a population's request [s].
_BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)

Counts = Mapping[str, float]


class Metrics:
    """The counters of one service, in a registry of their own.

    Attributes:
        live_clients: WebSockets that are open.
        reader_process: 1 while the readers' process answers.
    """

    def __init__(self) -> None:
        own = self.registry = CollectorRegistry()
        self._requests = Counter("fingertwin_requests", "Requests.", ["method", "route", "status"], registry=own)
        self._seconds = Histogram(
            "fingertwin_request_seconds", "Time to answer.", ["method", "route"], buckets=_BUCKETS, registry=own
        )
        self._chunks = Counter("fingertwin_ingest_chunks", "Chunks of readings stored.", registry=own)
        self._samples = Counter("fingertwin_ingest_samples", "Samples stored.", registry=own)
        self._bytes = Counter("fingertwin_ingest_bytes", "Bytes of chunks stored.", registry=own)
        self.live_clients = Gauge("fingertwin_live_clients", "WebSockets that are open.", registry=own)
        self.reader_process = Gauge("fingertwin_reader_process", "1 while the readers' process answers.", registry=own)
        # Of this process; on Linux only, the others do not say it in this form.
        ProcessCollector(registry=own)
        # A label is looked up once, then kept.
        self._counter, self._timer = lru_cache(1024)(self._requests.labels), lru_cache(1024)(self._seconds.labels)

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count an answer.

        Args:
            method: of HTTP.
            route: template of the address, never the address itself: each would be a series of its own.
            status: of HTTP.
            seconds: until it was complete [s].
        """
        named = method if method in _METHODS else "other"
        self._counter(named, route, str(status)).inc()
        self._timer(named, route).observe(seconds)

    def ingested(self, samples: int, size_bytes: int) -> None:
        """Count a chunk that was stored."""
        self._chunks.inc()
        self._samples.inc(samples)
        self._bytes.inc(size_bytes)

    def ask(self, name: str, text: str, counts: Callable[[], Counts | float | None], label: str = "") -> None:
        """Report what a function says whenever the metrics are asked for.

        Args:
            name: of the metric; one that only grows ends in `_total`.
            text: what it is.
            counts: gives a number, or numbers by the label's value; None where it is not known.
            label: its name, where there are several.
        """
        self.registry.register(_Asked(name, text, counts, label))

    def text(self) -> bytes:
        """Return everything in Prometheus' text format; it may wait for the database."""
        return generate_latest(self.registry)


class _Asked(Collector):
    def __init__(self, name: str, text: str, counts: Callable[[], Counts | float | None], label: str) -> None:
        self._name, self._text, self._counts, self._label = name, text, counts, label

    def describe(self) -> Iterable[Metric]:
        """Name it without asking, since nothing may be ready when it is registered."""
        return [self._family()]

    def collect(self) -> Iterable[Metric]:
        """Ask."""
        found = self._counts()
        family = self._family()
        if isinstance(found, Mapping):
            for key, value in sorted(found.items()):
                family.add_metric([key], value)
        elif found is not None:
            family.add_metric([], found)
        return [family]

    def _family(self) -> CounterMetricFamily | GaugeMetricFamily:
        kind = CounterMetricFamily if self._name.endswith("_total") else GaugeMetricFamily
        return kind(self._name, self._text, labels=[self._label] if self._label else [])
