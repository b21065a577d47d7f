"""Protocols: repeats of first cases, readings on loading, on unloading and after tapping, and what is refused."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import InputError
from daq.sessions.protocols import TAPPED, Protocol, plan, read_protocol
from tests.daq.bench_plays import PROTOCOL

ACTIONS = [
    ["load"],
    ["load", "tap"],
    ["load", "overload", "unload"],
    ["load", "overload", "unload", "tap"],
    ["load", "tap", "overload", "unload", "tap"],
    ["overload", "unload"],
    ["overload", "unload", "tap"],
]
BLOCKS = st.fixed_dictionaries(
    {
        "role": st.sampled_from(["identification", "validation"]),
        "location": st.sampled_from(["tip", "bone"]),
        "postures": st.lists(st.sampled_from(["hook", "relaxed"]), min_size=1, unique=True),
        "masses_g": st.lists(st.sampled_from([{"FDP": 950}, {"FDS": 500}, {}]), min_size=1, max_size=3),
        "actions": st.sampled_from(ACTIONS),
        "repeat_first": st.booleans(),
    }
)


def following(*blocks: dict[str, Any]) -> Protocol:
    return Protocol.model_validate(PROTOCOL | {"blocks": list(blocks)})


@given(st.lists(BLOCKS, min_size=1, max_size=3), st.integers(1, 2))
def test_each_setting_has_its_readings_and_where_asked_for_its_first_case_again(
    blocks: list[dict[str, Any]], repeats: int
) -> None:
    protocol = following(*blocks)
    cases, end_s = plan(protocol, repeats)
    assert [c.id for c in cases] == [f"c{k:03d}" for k in range(1, len(cases) + 1)]
    at = 0
    for block in blocks * repeats:
        read = [a for a in block["actions"] if a != "overload"]
        for posture in block["postures"]:
            count = len(read) * len(block["masses_g"])
            setting = cases[at : at + count + block["repeat_first"]]
            at += len(setting)
            assert len({(c.block_start_s, c.posture, c.location) for c in setting}) == 1
            assert setting[0].posture == posture
            assert [c.masses_g for c in setting[: count : len(read)]] == block["masses_g"]
            assert [c.repeat_of for c in setting[:count]] == [None] * count
            # What was overloaded before stays unloaded from it.
            told = [("overload" in block["actions"][:k], a == "tap") for k, a in enumerate(block["actions"])]
            told = [t for t, a in zip(told, block["actions"], strict=True) if a != "overload"]
            found = [(c.reading.direction == "unloading", c.reading.tapped) for c in setting[:count]]
            assert found == told * len(block["masses_g"])
            if block["repeat_first"]:
                again, first = setting[-1], setting[0]
                assert (again.repeat_of, again.masses_g, again.reading) == (first.id, first.masses_g, first.reading)
    assert at == len(cases)
    # One thing after the other, and windows away from each change.
    spans = [(c.load_start_s if c.overload_start_s is None else c.overload_start_s, c.loaded_s) for c in cases]
    for (_, (_, before_s)), (start_s, _) in pairwise(spans):
        assert before_s < start_s
    for c in cases:
        assert c.unloaded_s[1] < spans[cases.index(c)][0] <= c.load_start_s < c.loaded_s[0] < c.loaded_s[1] < end_s
        assert (c.overload_start_s is not None) == c.reading.overloading


def test_a_block_without_more_is_as_it_was() -> None:
    cases, end_s = plan(read_protocol("synek2019"))
    assert (len(cases), end_s) == (40, 248.0)
    assert all(c.told() == {} for c in cases)


def test_what_was_done_before_a_reading_is_told() -> None:
    block = PROTOCOL["blocks"][0] | {"actions": ["load", "tap", "overload", "unload", "tap"], "overload": 1.5}  # type: ignore[index]
    cases, _ = plan(following(block | {"masses_g": [{"FDP": 950}], "repeat_first": True}))
    unloaded = "unloaded from 1.5 times the weights"
    assert [c.told() for c in cases] == [
        {},
        {"note": TAPPED},
        {"direction": "unloading", "note": unloaded},
        {"direction": "unloading", "note": f"{TAPPED}, {unloaded}"},
        {"repeat_of": "c001"},
    ]


def test_the_shipped_protocols_repeat_and_tell_friction() -> None:
    levels, friction = read_protocol("levels"), read_protocol("friction")
    cases, _ = plan(levels)
    settings = {(c.block_start_s, c.posture) for c in cases}
    assert len([c for c in cases if c.repeat_of]) == len(settings) == 16
    assert {t for t, m in levels.heaviest_g().items() if m} == {"RI", "LU", "UI", "FDP", "FDS", "EDC"}
    alone = {next(iter(c.masses_g)) for c in cases if c.location == "bone" and len(c.masses_g) == 1}
    assert alone == {"RI", "UI", "FDP", "FDS", "EDC"}
    cases, _ = plan(friction)
    read = {at: {(c.posture, str(c.masses_g), c.reading) for c in cases if c.location == at} for at in ("tip", "bone")}
    assert read["tip"] == read["bone"]
    assert len(read["tip"]) == 2 * 5 * 3


def test_a_posture_that_no_session_can_have_is_refused_before_the_bench(tmp_path: Path) -> None:
    for angles, said in (
        ({"MCP": 0, "PIP": 200, "DIP": 50}, "hook.PIP is 200; expected an angle within"),
        ({"MCP": 0}, "lacks"),
    ):
        (tmp_path / "p.yaml").write_text(yaml.safe_dump(PROTOCOL | {"postures_deg": {"hook": angles}}))
        with pytest.raises(InputError, match=said):
            read_protocol(str(tmp_path / "p.yaml"))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"actions": []}, "none is not load, overload, unload, tap"),
        ({"actions": ["tap"]}, "tap is not load"),
        ({"actions": ["load", "unload"]}, "load unload is not"),
        ({"actions": ["load", "overload"]}, "load overload is not"),
        ({"actions": ["load", "load"]}, "load load is not"),
        ({"actions": ["load", "jog"]}, "must be 'load', 'overload', 'unload' or 'tap'"),
        ({"overload": 1.0}, "greater than 1"),
        ({"repeat_first": "often"}, "valid boolean"),
        ({"repeat": True}, "Extra inputs"),
    ],
)
def test_a_block_that_cannot_be_done_is_refused_in_one_line(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    block = PROTOCOL["blocks"][0] | changes  # type: ignore[index]
    (tmp_path / "p.yaml").write_text(yaml.safe_dump(PROTOCOL | {"blocks": [block]}))
    with pytest.raises(InputError) as caught:
        read_protocol(str(tmp_path / "p.yaml"))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
