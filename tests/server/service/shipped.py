"""Shipped sessions as workers are given them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from daq.recordings.plateaus import Plateau
from daq.recordings.readings import open_readings
from daq.recordings.windows import Span, gather
from daq.sessions import read_session
from daq.signals.corrections import windows_of
from server.service.jobs.bench_input import BenchInput


def bench_input(name: str, model: Mapping[str, Any] | str | None = None) -> BenchInput:
    session = read_session(name)
    plateaus: Mapping[Span, Plateau] = {}
    if session.readings_path is not None:
        plateaus = gather(open_readings(session.readings_path).blocks(), windows_of(session), name).plateaus
    document = session.entered.model_dump(mode="json", exclude_none=True)
    used = {window: plateaus[window] for window in windows_of(session)}
    return BenchInput(document, used, model=model, readings_sha256="f" * 64)
