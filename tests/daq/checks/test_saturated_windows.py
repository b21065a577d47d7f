"""Saturation is told of wherever a session is judged, and a channel that stands still in a window."""

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
    for found in (as_read, warnings_of(assemble(session, plateaus, notes), plateaus, None), check(session).findings):
        [at_limit] = [f for f in found if f.code == "saturated_window"]
        assert at_limit.where == "case c002: loaded_s"
        assert "Fy_N reaches 25" in at_limit.text
    assert len(measured.cases) == 2


@pytest.mark.parametrize(("noise", "said"), [(0.01, True), (0.002, False)])
def test_a_channel_without_noise_is_told_of_where_the_others_windows_have_some(
    tmp_path: Path, noise: float, said: bool
) -> None:
    """Of a cell that is coarser than its noise, windows without any are usual."""
    data = recorded(2)
    block = record([np.zeros(6), np.full(6, 1.0)] * 2, noise=noise)
    block.wrench[:] = np.round(block.wrench / 0.00625) * 0.00625
    start, end = window(3)
    block.wrench[(block.t_s >= start) & (block.t_s <= end), 1] = 1.0
    found = [f for f in check(save(tmp_path / "S1", data, block)).findings if f.code == "still_window"]
    assert [f.where for f in found] == ["case c002: loaded_s"] * said
