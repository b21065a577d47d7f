"""A simulated session's file and recording, to be changed as a bench may spoil them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml
from numpy.typing import NDArray
from pyarrow import parquet

from daq.recordings.columns import HEADERS

Floats = NDArray[np.float64]
# Forces [N] and moments [N mm] of the recording.
COMPONENTS = HEADERS[1:]


class Recorded:
    """A session's file and recording, to be changed and written back."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "session.yaml"
        self.document: dict[str, Any] = yaml.safe_load(self._file.read_text(encoding="utf-8"))
        self._readings = folder / str(self.document["readings"])
        self._table = parquet.read_table(self._readings)
        self.t_s: Floats = self._table["t_s"].to_numpy()
        self.values: Floats = np.array([self._table[n].to_numpy() for n in COMPONENTS]).T

    @property
    def postures(self) -> dict[str, dict[str, float]]:
        """Angles [deg] of each posture that an identification case was measured in."""
        return {name: angles for name, angles in self.document["postures_deg"].items() if name in self._identifying}

    @property
    def unseen_postures(self) -> dict[str, dict[str, float]]:
        """Angles [deg] of each posture that only validation cases were measured in."""
        used = {case["posture"] for case in self.document["cases"]} - self._identifying
        return {name: angles for name, angles in self.document["postures_deg"].items() if name in used}

    @property
    def _identifying(self) -> set[str]:
        return {case["posture"] for case in self.document["cases"] if case["role"] == "identification"}

    def within(self, case: dict[str, Any], window: str) -> NDArray[np.bool_]:
        """Which samples lie in a window of a case."""
        first, last = case[window]
        found: NDArray[np.bool_] = (self.t_s >= first) & (self.t_s <= last)
        return found

    def write(self) -> None:
        """Write both back."""
        for k, name in enumerate(COMPONENTS):
            self._table = self._table.set_column(
                self._table.column_names.index(name), name, pa.array(self.values[:, k])
            )
        parquet.write_table(self._table, self._readings)
        self._file.write_text(yaml.safe_dump(self.document, sort_keys=False), encoding="utf-8")
