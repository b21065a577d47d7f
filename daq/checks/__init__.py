"""Checks of a session: its description, recording, windows, load cases and known weights.

It imports `signals`, `recordings` and `sessions`; what it finds are `daq.findings`.
"""

from __future__ import annotations

from daq.checks.checking import begun_scan, check, measure_and_check, warnings_of
from daq.checks.recording import RecordingScan
from daq.findings import CheckReport, Finding

__all__ = ["CheckReport", "Finding", "RecordingScan", "begun_scan", "check", "measure_and_check", "warnings_of"]
