"""Saturation is told of wherever a session is judged, from its reduced windows alone too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.checks import check, measure_and_check, warnings_of
from daq.sessions import read_session
from daq.signals.corrections import assemble, gathered
from tests.daq.benches import record, recorded, save, window


@pytest.mark.parametrize("part", [1.0, 0.01])
def test_a_channel_at_its_limit_is_told_of_by_every_way_of_judging(tmp_path: Path, part: float) -> None:
    data = recorded(2)
    block = record([np.zeros(6), np.full(6, 1.0)] * 2, noise=0.01)
    start, end = window(3)
    block.wrench[(block.t_s >= start) & (block.t_s <= start + part * (end - start)), 1] = -25.0
    session = read_session(save(tmp_path / "S1", data, block))
    plateaus, notes = gathered(session)
    measured, as_read = measure_and_check(session)
    for found in (as_read, warnings_of(assemble(session, plateaus, notes), plateaus), check(session).findings):
        [at_limit] = [f for f in found if f.code == "saturated_window"]
        assert at_limit.where == "case c002: loaded_s"
        assert "Fy_N reaches 25" in at_limit.text
    assert len(measured.cases) == 2
