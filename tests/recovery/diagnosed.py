"""A session's folder, and what the product says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fingermodel.session import Session
from server.application.diagnosing import diagnosis_answer, run_diagnosis


def diagnosed(folder: Path) -> dict[str, Any]:
    """Diagnose the session in a folder."""
    bench = Session.open(folder)
    return diagnosis_answer(bench, run_diagnosis(bench))
