from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import SessionError
from daq.sessions import (
    TENDONS,
    Session,
    TensionEstimate,
    faults_of,
    parse_session,
    read_session,
    session_names,
    session_text,
    write_session,
)
from tests.daq.benches import WRENCH, averaged, bench, record, recorded, save

Change = Callable[[dict[str, Any]], object]


def case(data: dict[str, Any], i: int = 0) -> dict[str, Any]:
    out: dict[str, Any] = data["cases"][i]
    return out


def windowed(**changes: Any) -> Change:
    def change(data: dict[str, Any]) -> None:
        del case(data)["force_N"]
        data["readings"] = "r.csv"
        case(data).update({"unloaded_s": [0, 1], "loaded_s": [2, 3]} | changes)

    return change


def mount(**values: Any) -> Change:
    return lambda d: d["load_cell"]["mounts"].update(tip=values)


# What is changed in a good session, and what the one line must say.
BAD: dict[str, tuple[Change, list[str]]] = {
    "format": (lambda d: d.update(format="bench-session/2"), ["format", "bench-session/1"]),
    "no format": (lambda d: d.pop("format"), ["format is missing"]),
    "no cases": (lambda d: d.update(cases=[]), ["cases is empty"]),
    "cases no list": (lambda d: d.update(cases=3), ["cases is 3", "list"]),
    "tendon": (
        lambda d: case(d).update(masses_g={"FPD": 950}),
        ["cases[0] (c001): masses_g.FPD is not a tendon", "RI LU UI FDP FDS EDC", "Did you mean FDP?"],
    ),
    "mass negative": (lambda d: case(d).update(masses_g={"FDP": -3}), ["masses_g.FDP is -3", "not negative"]),
    "mass nan": (lambda d: case(d).update(masses_g={"FDP": float("nan")}), ["masses_g.FDP is nan", "finite"]),
    "mass text": (lambda d: case(d).update(masses_g={"FDP": "950 g"}), ["masses_g.FDP is '950 g'", "number in g"]),
    "mass comma": (lambda d: case(d).update(masses_g={"FDP": "9,5"}), ["decimal point"]),
    "mass bool": (lambda d: case(d).update(masses_g={"FDP": True}), ["masses_g.FDP is True"]),
    "masses list": (lambda d: case(d).update(masses_g=[950]), ["masses_g is [950]"]),
    "no masses": (lambda d: case(d).pop("masses_g"), ["masses_g is missing", "FDP"]),
    "role": (lambda d: case(d).update(role="identifcation"), ["role", "identification validation", "Did you mean"]),
    "location": (lambda d: case(d).update(location="bones"), ["location", "tip bone", "Did you mean bone?"]),
    "posture": (lambda d: case(d).update(posture="hok"), ["posture is 'hok'", "Did you mean hook?"]),
    "duplicate": (lambda d: case(d, 1).update(id="c001"), ["cases[1] (c001): id", "cases[0]", "different id"]),
    "repeat_of": (lambda d: case(d).update(repeat_of="c009"), ["repeat_of is 'c009'", "Did you mean"]),
    "force two": (lambda d: case(d).update(force_N=[1, 2]), ["force_N", "3 numbers in N"]),
    "force nan": (lambda d: case(d).update(force_N=[1, 2, float("inf")]), ["force_N[2] is inf", "finite"]),
    "neither": (lambda d: case(d).pop("force_N"), ["neither force_N nor unloaded_s nor loaded_s"]),
    "both": (
        lambda d: (d.update(readings="r"), case(d).update(loaded_s=[0, 1], unloaded_s=[2, 3])),
        ["has both windows and force_N"],
    ),
    "one window": (lambda d: (windowed()(d), case(d).pop("unloaded_s")), ["lacks unloaded_s"]),
    "reversed": (windowed(loaded_s=[3, 2]), ["loaded_s is [3, 2]", "end after the start"]),
    "one number": (windowed(loaded_s=[3]), ["loaded_s is [3]", "[start, end] in s"]),
    "window nan": (windowed(loaded_s=[float("nan"), 2]), ["loaded_s[0] is nan"]),
    "window order": (windowed(loaded_s=[5, 6], unloaded_after_s=[2, 4]), ["unloaded_after_s before loaded_s"]),
    "no readings": (lambda d: (windowed()(d), d.pop("readings")), ["windows", "names no readings"]),
    "readings absent": (windowed(), ["'r.csv'", "not in"]),
    "readings outside": (lambda d: d.update(readings="../../secret.csv"), ["inside the session's folder"]),
    "sd zero": (lambda d: case(d).update(force_sd_N=0), ["force_sd_N is 0", "above zero"]),
    "sd and cov": (
        lambda d: case(d).update(force_sd_N=0.1, force_cov_N2=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ["both force_sd_N and force_cov_N2"],
    ),
    "cov of rank 1": (lambda d: case(d).update(force_cov_N2=[[1, 1, 1]] * 3), ["exact in no direction"]),
    "cov of nothing": (lambda d: case(d).update(force_cov_N2=[[0, 0, 0]] * 3), ["exact in no direction"]),
    "cov": (lambda d: case(d).update(force_cov_N2=[[1, 2, 0], [0, 1, 0], [0, 0, 1]]), ["symmetric"]),
    "setting": (lambda d: case(d).update(setting=-1), ["setting is -1", "from 0 up"]),
    "direction": (lambda d: case(d).update(direction="unload"), ["direction", "Did you mean unloading?"]),
    "tension high": (lambda d: d.update(tension_factor=1.6), ["tension_factor is 1.6", "0 < c"]),
    "tension zero": (lambda d: d.update(tension_factor=0), ["tension_factor is 0"]),
    "tension nan": (lambda d: d.update(tension_factor=float("nan")), ["tension_factor is nan"]),
    "tension key": (lambda d: d.update(tension_factor={"estimat": "force_balance"}), ["tension_factor"]),
    "tension word": (lambda d: d.update(tension_factor={"estimate": "balance"}), ["force_balance"]),
    "no tension": (lambda d: d.pop("tension_factor"), ["tension_factor is missing", "0.835"]),
    "gravity": (lambda d: d.update(gravity_m_s2=9810), ["gravity_m_s2 is 9810", "9.81"]),
    "angle": (lambda d: d["postures_deg"]["hook"].update(PIP=200), ["postures_deg.hook.PIP is 200", "180"]),
    "angle missing": (lambda d: d["postures_deg"]["hook"].pop("DIP"), ["hook lacks DIP"]),
    "angle misspelt": (
        lambda d: d["postures_deg"].update(hook={"MPC": 0, "PIP": 65, "DIP": 50}),
        ["hook.MPC", "Did you mean MCP?"],
    ),
    "posture no map": (lambda d: d["postures_deg"].update(hook=[0, 65, 50]), ["postures_deg.hook is [0, 65, 50]"]),
    "specimen name": (lambda d: d["specimen"].update(name="Jane"), ["specimen.name is not a known key"]),
    "side": (lambda d: d["specimen"].update(side="sinister"), ["specimen.side", "left right"]),
    "no side": (lambda d: d["specimen"].pop("side"), ["specimen.side is missing", "left or right"]),
    "mirror": (mount(rotation=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), ["tip.rotation has determinant -1"]),
    "skew": (mount(rotation=[[1, 0.01, 0], [0, 1, 0], [0, 0, 1]]), ["tip.rotation is not orthonormal"]),
    "two rotations": (
        mount(rotation=[[1, 0, 0], [0, 1, 0], [0, 0, 1]], rotation_deg=[0, 0, 0]),
        ["tip has both rotation and rotation_deg"],
    ),
    "rotation two": (mount(rotation_deg=[0, 0]), ["rotation_deg is [0, 0]", "3 numbers"]),
    "mount key": (mount(rotaton_deg=[0, 0, 0]), ["rotaton_deg is not a known key", "Did you mean rotation_deg?"]),
    "mount name": (lambda d: d["load_cell"]["mounts"].update(tips={}), ["tips", "Did you mean tip?"]),
    "mount absent": (lambda d: d["load_cell"]["mounts"].pop("bone"), ["cases[1] (c002): location is bone", "mounts"]),
    "rate": (lambda d: d["load_cell"].update(rate_hz=-1), ["load_cell.rate_hz is -1"]),
    "event": (lambda d: d.update(events=[{"t_s": 1, "kind": "tear"}]), ["events[0]", "kind", "Did you mean tare?"]),
    "budget": (lambda d: d.update(budget=0.1), ["budget is 0.1"]),
    "check": (
        lambda d: d.update(
            readings="r",
            checks=[
                {
                    "when": "before",
                    "mount": "tip",
                    "mass_g": 500,
                    "direction": "upwards",
                    "unloaded_s": [0, 1],
                    "loaded_s": [2, 3],
                }
            ],
        ),
        ["checks[0]", "direction is 'upwards'", "+x"],
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_clear_line(name: str, tmp_path: Path) -> None:
    change, words = BAD[name]
    data = averaged()
    change(data)
    with pytest.raises(SessionError) as caught:
        bench(tmp_path / "S1", data)
    line = str(caught.value)
    assert "\n" not in line
    for word in words:
        assert word in line
    assert "pydantic" not in line


def test_several_faults_are_all_listed(tmp_path: Path) -> None:
    data = averaged()
    case(data)["masses_g"] = {"FPD": 1}
    case(data, 1)["posture"] = "nowhere"
    case(data, 1)["role"] = "both"
    folder = save(tmp_path / "S1", data)
    faults = [str(f) for f in faults_of(folder)]
    assert len(faults) == 3
    with pytest.raises(SessionError, match=r"lists 2 more"):
        read_session(folder)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["is empty", "format: bench-session/1"]),
        ("- 1\n- 2\n", ["has no keys with values"]),
        ("format: bench-session/1\nid: [1, 2\n", ["not YAML in line"]),
        (
            "format: bench-session/1\nformat: bench-session/1\n",
            ["'format' is there twice", "line 2", "Remove one of them"],
        ),
        ("format: bench-session/1\nid: !!python/object:os.system x\n", ["not YAML in line 2"]),
        (b"\xff\xfe\x00", ["not UTF-8", "Save it as UTF-8"]),
    ],
)
def test_a_file_that_is_no_session(text: str | bytes, words: list[str], tmp_path: Path) -> None:
    file = tmp_path / "session.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SessionError) as caught:
        read_session(file)
    assert all(word in str(caught.value) for word in words)


def test_absent_sessions(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="has no session") as caught:
        read_session(tmp_path)
    assert "--resume" not in str(caught.value)
    (tmp_path / "journal.sqlite3").touch()
    with pytest.raises(SessionError, match=r"has no session.*with --resume goes on"):
        read_session(tmp_path)
    with pytest.raises(SessionError, match=r"no session at .*Did you mean synek2019_H01\?"):
        read_session("synek2019_H1")


def test_shipped_sessions_are_found_by_name() -> None:
    names = session_names()
    assert {"DEV-01", "synek2019_H01", "synek2019_HMEAN"} <= set(names)
    for name in names:
        session = read_session(name)
        assert session.id == name
        assert session.folder is not None
        assert (session.readings_path is None) == (session.readings is None)


@pytest.mark.parametrize("name", ["DEV-01", "synek2019_H01", "synek2019_HMEAN"])
def test_round_trip(name: str, tmp_path: Path) -> None:
    session = read_session(name)
    written = write_session(session, tmp_path / name)
    again = read_session(written)
    assert again.in_folder(None) == session.in_folder(None)
    assert [p.name for p in (tmp_path / name).iterdir() if p.name.startswith(".")] == []


def test_everything_optional_survives(tmp_path: Path) -> None:
    data = recorded(2, after=True)
    data |= {
        "tension_factor": {"estimate": "force_balance"},
        "events": [{"t_s": 1.0, "kind": "moisten", "text": "saline"}, {"t_s": 2, "kind": "temperature", "value": 21.5}],
        "environment": {"room_C": 21, "cell_C": 24.5, "thawed_utc": "2024-03-01T08:00:00Z"},
        "budget": {"tension_factor_sd": 0.012, "tendon_point_sd_mm": {"DIP": 0.6}},
        "protocol": "levels",
        "provenance": "a test",
        "checks": [
            {
                "when": "before",
                "mount": "tip",
                "mass_g": 500,
                "direction": "palmar",
                "unloaded_s": [0.5, 1.5],
                "loaded_s": [4.5, 5.5],
            }
        ],
        "extra": {"kept": 1},
    }
    data["specimen"] |= {"sex": "female", "age_band": "80-89", "freeze_thaw_cycles": 1, "ethics_ref": "E1"}
    data["load_cell"]["mounts"] = {"tip": {"rotation_deg": [10, 20, 30], "offset_mm": [1, 2, 3]}, "bone": {}}
    case(data).update(setting=2, mounting=1, direction="unloading", unloaded_state="hanger_on", note="n")
    case(data, 1).update(repeat_of="c001", excluded="slipped", colour="red")
    session = bench(tmp_path / "a", data, record([0 * WRENCH] * 5))
    assert session.checks[0].direction == (0.0, -1.0, 0.0)
    assert isinstance(session.tension_factor, TensionEstimate)
    assert session.unknown_keys() == {"extra": ""}
    again = read_session(write_session(session, tmp_path / "b"))
    assert again.in_folder(None) == session.in_folder(None)
    assert again.readings_path is not None
    assert again.readings_path.is_file()


masses = st.dictionaries(st.sampled_from(TENDONS), st.just(0.0) | st.floats(1, 2000), max_size=6)
forces = st.tuples(*[st.floats(-50, 50)] * 3).map(list)


@given(masses, forces, st.floats(0.01, 1.5), st.integers(0, 5), st.text("abcXYZ019-_", min_size=1))
def test_any_good_session_round_trips_through_yaml(
    masses_g: dict[str, float], force_N: list[float], factor: float, setting: int, name: str
) -> None:
    data = averaged()
    data["tension_factor"] = factor
    case(data).update(masses_g=masses_g, force_N=force_N, setting=setting, id=f"n{name}")
    session, faults = parse_session(data, None)
    assert session is not None, faults
    plain = session.model_dump(mode="json", exclude_none=True)
    again, _ = parse_session(yaml.safe_load(yaml.safe_dump(plain)), None)
    assert again == session


plain = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.text("ab", max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("ab", max_size=2), inner, max_size=3),
    max_leaves=6,
)
places = [
    ("specimen",), ("load_cell",), ("load_cell", "mounts"), ("load_cell", "mounts", "tip"), ("tension_factor",),
    ("postures_deg",), ("postures_deg", "hook"), ("cases",), ("cases", 0), ("cases", 0, "masses_g"),
    ("cases", 0, "force_N"), ("cases", 0, "loaded_s"), ("cases", 0, "id"), ("cases", 0, "posture"), ("checks",),
    ("cases", 0, "repeat_of"), ("cases", 0, "setting"), ("cases", 0, "force_cov_N2"), ("cases", 0, "force_sd_N"),
    ("events",), ("environment",), ("budget",), ("provenance",), ("readings",), ("id",), ("gravity_m_s2",), ("finger",),
    ("protocol",),
]  # fmt: skip


@given(st.sampled_from(places), plain)
@settings(max_examples=300)
def test_no_data_whatsoever_gives_another_exception(place: tuple[str | int, ...], value: Any) -> None:
    data: Any = averaged()
    node = data
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = value
    session, faults = parse_session(data, None)
    assert (session is None) == bool(faults)
    for fault in faults:
        assert isinstance(fault, SessionError)
        assert "\n" not in str(fault)


def test_numbers_that_yaml_leaves_as_text(tmp_path: Path) -> None:
    text = yaml.safe_dump(averaged()).replace("950.0", "9.5e2").replace("id: S1", "id: 17")
    (tmp_path / "session.yaml").write_text(text)
    session = read_session(tmp_path)
    assert session.id == "17"
    assert session.cases[0].masses_g == {"FDP": 950.0}


def test_other_fingers_joints_are_kept() -> None:
    data = averaged()
    data["postures_deg"]["hook"] = {"CMC": 20, "MP": 10, "IP": 30}
    session, _ = parse_session(data, None)
    assert session is not None
    assert session.postures_deg["hook"].model_dump()["CMC"] == 20.0


def test_records_are_frozen() -> None:
    session: Session = read_session("synek2019_H01")
    with pytest.raises(ValueError, match="frozen"):
        session.cases[0].role = "validation"


def test_reading_changes_nothing_in_the_data() -> None:
    data = averaged()
    before = copy.deepcopy(data)
    parse_session(data, None)
    assert data == before


def test_thousands_of_slips_are_all_told_and_the_first_are_helped_with() -> None:
    data = averaged()
    first = case(data)
    data["cases"] = [{**first, "id": f"c{i:04d}", "repeat_of": f"c{i:04d}x", "posture": f"q{i}"} for i in range(1500)]
    data["postures_deg"] = {f"p{i}": data["postures_deg"]["hook"] for i in range(1500)}
    data["amendments"] = [{"case": f"d{i}", "posture": "r", "why": "x", "at": "now"} for i in range(1500)]
    session, faults = parse_session(data, None)
    assert session is None
    assert len(faults) == 4 * 1500
    said = [str(f) for f in faults]
    assert all(len(line) < 500 for line in said)
    assert "and 1480 more" in said[0]
    assert 20 <= sum("Did you mean" in line for line in said) <= 60


def test_a_description_of_many_cases_is_the_text_of_the_whole_and_reads_back() -> None:
    data = averaged()
    data["cases"] = [data["cases"][k % 2] | {"id": f"c{k:03d}", "note": "cases: []"} for k in range(451)]
    data["operator_note"] = "two lines\ncases: []\n"
    session, faults = parse_session(data, None)
    assert (session is not None, faults) == (True, [])
    assert session is not None
    text = session_text(session)
    again, _ = parse_session(yaml.safe_load(text), None)
    assert again == session
    assert again is not None
    assert session_text(again) == text
