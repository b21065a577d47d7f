from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from daq.corrections import measure
from daq.errors import InputError
from daq.export import export_cases
from daq.sessions import read_session


@pytest.mark.parametrize("name", ["DEV-01", "synek2019_H01"])
def test_csv_and_parquet_hold_the_measured_cases(name: str, tmp_path: Path) -> None:
    measured = measure(read_session(name))
    table = pyarrow.parquet.read_table(export_cases(measured, tmp_path / "cases.parquet")).to_pydict()
    with export_cases(measured, tmp_path / "cases.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert table["id"] == [r["id"] for r in rows] == [m.case.id for m in measured.cases]
    np.testing.assert_array_equal(table["Fx_N"], [m.wrench[0] for m in measured.cases])
    np.testing.assert_array_equal([float(r["Fy_N"]) for r in rows], [m.wrench[1] for m in measured.cases])
    i = next(i for i, m in enumerate(measured.cases) if m.case.masses_g.get("FDP"))
    assert float(rows[i]["FDP_g"]) == measured.cases[i].case.masses_g["FDP"]
    assert float(rows[i]["PIP_deg"]) == measured.session.postures_deg[measured.cases[i].case.posture].PIP
    if name == "DEV-01":
        sd = np.sqrt(np.diag(measured.case_covariance(0)))
        assert float(rows[0]["Tz_sd_Nmm"]) == pytest.approx(sd[5])
    else:
        # Nothing is made up where nothing was published.
        assert rows[0]["Tx_Nmm"] == rows[0]["Fx_sd_N"] == rows[0]["loaded_mid_s"] == ""
        assert table["Tx_Nmm"][0] is None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cases.csv", "cases.parquet"]


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.csv or \.parquet"):
        export_cases(measure(read_session("synek2019_H01")), tmp_path / "cases.xlsx")
