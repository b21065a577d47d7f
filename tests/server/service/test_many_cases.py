"""A session of many load cases: work and memory grow as the number of cases, whatever is asked of it."""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

from server.service.exports.exporting import session_export
from server.service.exports.reports import checked, report_page
from server.service.models.case_updates import case_bodies
from server.service.services import Services
from tests.daq.benches import averaged_of_many
from tests.server.service.running import ServiceReceiver

FEW = 100


def steps(parts: Services, name: str, count: int, folder: Path) -> dict[str, Callable[[], object]]:
    """What is asked of a session of so many cases, in this order."""

    def export(kind: str) -> object:
        return session_export(parts, name, kind, None)(Path(tempfile.mkdtemp(dir=folder)))

    def begin() -> None:
        parts.sessions.create(name, averaged_of_many(name, count))
        parts.case_updates.settle(60.0)  # so that no other thread does the work of what follows

    def edit() -> None:
        parts.sessions.edit(name, "exclude", "c00001", {"reason": "slipped"})
        parts.case_updates.settle(60.0)

    kinds = ("csv", "parquet", "xlsx", "hdf5", "mat", "folder", "supplement")
    return {
        "begin": begin,
        "cases": lambda: case_bodies(parts.measuring.of(name), parts.models),
        "edit": edit,
        "cases after it": lambda: case_bodies(parts.measuring.of(name), parts.models),
        "comparison": lambda: parts.models.comparison(name),
        "check": lambda: checked(parts, name),
        "report": lambda: report_page(parts, name, None, None),
        **{kind: partial(export, kind) for kind in kinds},
    }


def calls_of(act: Callable[[], object]) -> int:
    profile = cProfile.Profile()
    profile.runcall(act)
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


def memory_of(act: Callable[[], object]) -> int:
    """Most bytes that were in use at once."""
    tracemalloc.start()
    try:
        act()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_whatever_is_asked_of_four_times_the_cases_costs_about_four_times_as_much(tmp_path: Path) -> None:
    service, grown = ServiceReceiver(tmp_path / "service"), dict[tuple[str, str], float]()
    try:
        for act in steps(service.parts, "warm", FEW, tmp_path).values():
            act()  # what is loaded and compiled once
        for cost, least in ((calls_of, 20_000), (memory_of, 2_000_000)):
            few, many = (
                {step: cost(act) for step, act in steps(service.parts, f"{cost.__name__}-{n}", n, tmp_path).items()}
                for n in (FEW, 4 * FEW)
            )
            grown |= {(step, cost.__name__): many[step] / max(few[step], least) for step in few}
    finally:
        service.close()
    assert {step: ratio for step, ratio in grown.items() if ratio > 6} == {}
