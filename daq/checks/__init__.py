"""Checks of a session: its description, recording, windows, load cases and known weights.

It imports `signals`, `recordings` and `sessions`; what it finds are `daq.findings`.
"""

from __future__ import annotations

from daq.checks.checking import check, measure_and_check, warnings_of
from daq.findings import CheckReport, Finding

__all__ = ["CheckReport", "Finding", "check", "measure_and_check", "warnings_of"]
