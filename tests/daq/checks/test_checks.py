from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.checks import CheckReport, check
from daq.recordings.readings import ReadingBlock
from daq.sessions import session_names
from tests.daq.benches import averaged, creeping, record, recorded, save, window

ZERO = np.array([0.4, -1.2, 3.0, 7.0, -5.0, 2.0])
TIP = np.array([-0.9, -2.0, 0.1, 0.5, 0.2, 12.0])
BONE = np.array([9.0, -0.4, 0.2, 3.0, -2.0, 30.0])
CHECK = np.array([0.0, -1.962, 0.0, 0.0, 0.0, 0.0])

Blocks = list[ReadingBlock]
Change = Callable[[dict[str, Any], ReadingBlock], Blocks | None]


def good() -> tuple[dict[str, Any], ReadingBlock]:
    """Four cases at tip and bone in two postures, and a known weight before and after; nothing is wrong with it."""
    data = recorded(4)
    for case in data["cases"][2:]:
        case.update(location="bone", masses_g={"FDP": 950, "FDS": 300})
    weight = {"mount": "tip", "mass_g": 200, "direction": "-y"}
    data["checks"] = [
        {"when": "before", **weight, "unloaded_s": window(8), "loaded_s": window(9)},
        {"when": "after", **weight, "unloaded_s": window(10), "loaded_s": window(11)},
    ]
    levels = [ZERO, ZERO + TIP, ZERO, ZERO + TIP, ZERO, ZERO + BONE, ZERO, ZERO + BONE]
    levels += [ZERO, ZERO + CHECK, ZERO, ZERO + CHECK]
    scale = np.array([0.03] * 3 + [0.5] * 3)
    block = record(levels)
    return data, ReadingBlock(block.t_s, block.wrench + scale * np.random.default_rng(0).normal(size=(len(block), 6)))


def examined(folder: Path, change: Change | None = None) -> CheckReport:
    data, block = good()
    blocks = None if change is None else change(data, block)
    return check(save(folder / "S1", data, *([block] if blocks is None else blocks)))


def codes(report: CheckReport, level: str = "") -> set[str]:
    return {f.code for f in report.findings if not level or f.level == level}


def test_nothing_is_wrong_with_a_good_session(tmp_path: Path) -> None:
    report = examined(tmp_path)
    assert report.ok
    assert report.errors == ()
    assert report.warnings == (), report.warnings


@pytest.mark.parametrize("name", session_names())
def test_nothing_is_wrong_with_the_shipped_sessions(name: str) -> None:
    report = check(name)
    assert report.ok
    assert report.warnings == (), report.warnings


def cut(block: ReadingBlock, keep: NDArray[np.bool_] | slice) -> Blocks:
    return [ReadingBlock(block.t_s[keep], block.wrench[keep])]


def drop(start_s: float, end_s: float) -> Change:
    return lambda _, b: cut(b, (b.t_s < start_s) | (b.t_s > end_s))


def swap_times(_: dict[str, Any], b: ReadingBlock) -> None:
    b.t_s[[700, 701]] = b.t_s[[701, 700]]


def pause(_: dict[str, Any], b: ReadingBlock) -> None:
    b.t_s[b.t_s > 47.8] += 30.0


def clip(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, 1] = np.where(b.wrench[:, 1] < -3.0, -25.0, b.wrench[:, 1])


def held(segment: int, value: float, **values: Any) -> Change:
    """One channel at a value for a segment of the recording; and change its case."""

    def change(data: dict[str, Any], b: ReadingBlock) -> None:
        start, end = window(segment)
        b.wrench[(b.t_s >= start) & (b.t_s <= end), 0] = value
        data["cases"][segment // 2 % 4].update(values)

    return change


def bumped(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:20, 0] = 25.0


def poison(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[900, 3] = np.nan


def constant(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, 1] = 1.5


def constant_moment(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, 4] = 1.5


def spike(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[np.searchsorted(b.t_s, sum(window(1)) / 2.0), 0] += 20.0


def stick(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[1000:1300, 0] = b.wrench[1000, 0]


def creep(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[400:800, 1] += 0.6 * np.exp(-np.arange(400) / 200)


def wander(data: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, 2] += 0.05 * b.t_s
    for case in data["cases"]:
        case["posture"] = "hook"
        case["location"] = "tip"
        case["masses_g"] = {"FDP": 950}


def flag(_: dict[str, Any], b: ReadingBlock) -> Blocks:
    status = np.zeros(len(b), dtype=np.int64)
    status[500:520] = 1 << 30
    return [ReadingBlock(b.t_s, b.wrench, status)]


def turn_sign(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, :] *= -1.0


def exchange_axes(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, [1, 2]] = b.wrench[:, [2, 1]]


def scaled(factor: float, after_s: float = 0.0) -> Change:
    def change(_: dict[str, Any], b: ReadingBlock) -> None:
        b.wrench[b.t_s >= after_s, :3] *= factor

    return change


def leak(_: dict[str, Any], b: ReadingBlock) -> None:
    b.wrench[:, 2] += 0.1 * b.wrench[:, 1]


def case(i: int = 0, **values: Any) -> Change:
    return lambda d, _: d["cases"][i].update(values)


def every_case(**values: Any) -> Change:
    return lambda d, _: [c.update(values) for c in d["cases"]] and None


def top(**values: Any) -> Change:
    return lambda d, _: d.update(values)


def small_angles(data: dict[str, Any], _: ReadingBlock) -> None:
    for posture in data["postures_deg"].values():
        posture.update({joint: angle / 57.3 for joint, angle in posture.items()})


def light(data: dict[str, Any], _: ReadingBlock) -> None:
    data["light_masses"] = True
    data["cases"][0]["masses_g"] = {"FDP": 0.95}


def overloaded(data: dict[str, Any], _: ReadingBlock) -> None:
    """More than the published protocol hangs on FDP, though less than anything else would remark."""
    data["protocol"] = "synek2019"
    data["cases"][0]["masses_g"] = {"FDP": 1000}


DEFECTS: dict[str, tuple[Change, str, str]] = {
    "time order": (swap_times, "error", "time_order"),
    "nan": (poison, "error", "readings"),
    "gap": (drop(17.0, 17.3), "warning", "gaps"),
    "gap in window": (drop(5.0, 5.4), "warning", "gap_in_window"),
    "window in a gap": (drop(4.0, 8.0), "error", "window_empty"),
    "jump": (pause, "warning", "time_jump"),
    "rate": (lambda d, _: d["load_cell"].update(rate_hz=125), "warning", "sample_rate"),
    "saturation": (clip, "error", "saturation"),
    "saturated window": (clip, "error", "saturated_window"),
    "saturated tare": (held(0, 25.0), "error", "saturated_window"),
    "saturated known weight": (held(9, 25.0), "error", "saturated_window"),
    "saturated case that is left out": (held(1, 25.0, excluded="saturated"), "warning", "saturation"),
    "channel that stands still": (held(1, -0.5), "warning", "still_window"),
    "saturation apart from windows": (bumped, "warning", "saturation"),
    "posture set since": (top(events=[{"t_s": 4.1, "kind": "set_posture"}]), "warning", "stale_tare"),
    "tare of two postures": (case(1, unloaded_s=window(0)), "warning", "stale_tare"),
    "constant": (constant, "error", "constant_channel"),
    "constant moment": (constant_moment, "warning", "constant_channel"),
    "stuck": (stick, "warning", "stuck_channel"),
    "status": (flag, "warning", "status_flags"),
    "wild reading": (spike, "warning", "wild_reading"),
    "flagged window": (flag, "warning", "flagged_window"),
    "outside": (case(loaded_s=[900.0, 903.0]), "error", "window_outside"),
    "cut off": (lambda _, b: cut(b, slice(0, 4300)), "error", "window_outside"),
    "straddles before": (case(loaded_s=[3.0, 6.0]), "error", "load_change"),
    "straddles after": (case(1, loaded_s=[14.0, 17.0]), "error", "load_change"),
    "tare straddles": (case(2, unloaded_s=[15.0, 18.5]), "error", "load_change"),
    "weight straddles": (lambda d, _: d["checks"][0].update(loaded_s=[35.5, 38.5]), "error", "load_change"),
    "overlap in a case": (case(loaded_s=[3.0, 7.0]), "error", "overlap"),
    "overlap of cases": (case(1, loaded_s=[4.6, 7.6], unloaded_s=[0.5, 3.5]), "error", "overlap"),
    "row copied": (lambda d, _: d["cases"].append(d["cases"][1] | {"id": "copy"}), "warning", "same_readings"),
    "creep": (creep, "warning", "not_steady"),
    "tares wander": (wander, "warning", "tare_drift"),
    "sign": (turn_sign, "warning", "wrong_sign"),
    "sign of the weight": (turn_sign, "error", "weight_sign"),
    "axis of the weight": (exchange_axes, "error", "weight_axis"),
    "gain": (scaled(1.05), "warning", "weight_gain"),
    "gain changed": (scaled(0.97, after_s=40.0), "warning", "weight_change"),
    "crosstalk": (leak, "warning", "weight_crosstalk"),
    "kg": (every_case(masses_g={"FDP": 0.95}), "error", "session"),
    "kg, said to be meant": (light, "warning", "mass_units"),
    "newton": (case(masses_g={"FDP": 9.32}), "warning", "mass_units"),
    "radians": (small_angles, "warning", "angle_units"),
    "beyond": (case(masses_g={"FDP": 1500}), "warning", "load_beyond_protocol"),
    "no such protocol": (top(protocol="own.yaml"), "warning", "unknown_protocol"),
    "beyond the named protocol": (overloaded, "warning", "load_beyond_protocol"),
    "beyond, small": (case(masses_g={"LU": 300}), "warning", "load_beyond_protocol"),
    "force too large": (every_case(masses_g={"FDP": 40}), "warning", "force_units"),
    "one posture": (every_case(posture="hook"), "warning", "single_posture"),
    "no validation": (every_case(role="identification"), "note", "no_validation"),
    "no identification": (every_case(role="validation"), "warning", "no_identification"),
    "no bone": (every_case(location="tip"), "note", "no_bone"),
    "top key": (top(gravity=9.81), "warning", "unknown_key"),
    "case key": (case(unloaded_after=[8.5, 11.5]), "warning", "unknown_key"),
    "finger": (top(finger="an1979_midle"), "error", "unknown_finger"),
    "gravity": (top(gravity_m_s2=9.6), "warning", "gravity"),
    "frame": (lambda d, _: d["load_cell"]["mounts"].update(tip={"frame": "metacarpal"}), "warning", "frame"),
    "cell": (lambda d, _: d["load_cell"].update(model="ATI Nano17-E"), "note", "saturation_skipped"),
    "excluded": (case(excluded="slipped"), "note", "excluded"),
    "sd beside windows": (case(force_sd_N=0.1), "warning", "ignored_key"),
    "no weight": (case(masses_g={}), "note", "no_weight"),
}


def test_one_wild_reading_is_named_and_is_no_change_of_level(tmp_path: Path) -> None:
    report = examined(tmp_path, spike)
    assert {"wild_reading", "load_change"} & codes(report, "warning") == {"wild_reading"}
    [found] = [f for f in report.findings if f.code == "wild_reading"]
    assert f"Fx_N at {sum(window(1)) / 2.0:.3g}" in found.text


@pytest.mark.parametrize(("over_s", "said"), [(0.005, False), (0.05, True)])
def test_a_window_that_ends_between_two_readings_holds_no_gap(over_s: float, said: bool, tmp_path: Path) -> None:
    """The bench takes windows that reach half an interval beyond their first and last readings."""
    start, end = window(1)

    def alone(data: dict[str, Any], b: ReadingBlock) -> Blocks:
        data["cases"][0]["loaded_s"] = [start - over_s, end + over_s]
        near = (b.t_s > start - 0.4) & (b.t_s < end + 0.4)
        return cut(b, ~near | ((b.t_s > start - 0.001) & (b.t_s < end + 0.001)))

    assert ("gap_in_window" in codes(examined(tmp_path, alone))) == said


def test_status_bits_of_gauges_are_told_where_no_manual_tells_them(tmp_path: Path) -> None:
    [found] = [f for f in examined(tmp_path, flag).findings if f.code == "status_flags"]
    assert "Of gauge volts, bit 0 is gauge 1 at the end of its range" in found.text


@pytest.mark.parametrize("name", DEFECTS)
def test_each_defect_is_found(name: str, tmp_path: Path) -> None:
    change, level, code = DEFECTS[name]
    report = examined(tmp_path, change)
    found = [f for f in report.findings if f.code == code]
    assert found, report.findings
    assert found[0].level == level
    assert report.ok == (not report.errors)
    for f in report.findings:
        assert f.text.endswith((".", "?"))
        assert "\n" not in f.text
        assert f.where


@pytest.mark.parametrize(("share", "level"), [(0.0, None), (0.008, "note"), (0.1, "warning")])
def test_it_is_said_where_readings_creep_as_a_rule(share: float, level: str | None, tmp_path: Path) -> None:
    data, block = creeping(share)
    found = {f.code: f.level for f in check(save(tmp_path / "S1", data, block)).findings}
    assert found.get("creep") == level


def test_columns_are_checked(tmp_path: Path) -> None:
    data, block = good()
    folder = save(tmp_path / "S1", data, block)
    path = folder / "readings.csv"
    text = path.read_text()
    for before, after, code in (
        ("Fy_N", "other_N", "missing_column"),
        ("Fy_N", "Fx_lbf", "duplicate_column"),
        ("Fy_N", "Fy", "no_unit"),
        ("Fy_N", "Fy_V", "unknown_unit"),
    ):
        path.write_text(text.replace(before, after, 1))
        assert code in codes(check(folder), "error")
    path.write_text(text.replace("Fy_N", "Fy_kgf", 1))
    assert "conversion" in codes(check(folder), "note")


def test_a_damaged_file_is_found(tmp_path: Path) -> None:
    data, block = good()
    data["readings"] = "readings.parquet"
    folder = save(tmp_path / "S1", data, block)
    path = folder / "readings.parquet"
    path.write_bytes(path.read_bytes()[:1000])
    assert "damaged_file" in codes(check(folder), "error")


def test_everything_is_collected(tmp_path: Path) -> None:
    def change(data: dict[str, Any], block: ReadingBlock) -> None:
        constant(data, block)
        data["cases"][0].update(loaded_s=[900.0, 903.0])
        data["cases"][1].update(loaded_s=[14.0, 17.0], masses_g={"FDP": 2000})
        data["surprise"] = 1

    report = examined(tmp_path, change)
    assert {"constant_channel", "window_outside", "load_change"} <= codes(report, "error")
    assert {"load_beyond_protocol", "unknown_key"} <= codes(report, "warning")
    assert [f.level for f in report.findings] == sorted(
        (f.level for f in report.findings), key="error warning note".find
    )


def test_every_fault_of_the_description_is_listed_and_the_recording_still_looked_at(tmp_path: Path) -> None:
    def change(data: dict[str, Any], block: ReadingBlock) -> None:
        constant(data, block)
        data["cases"][0]["masses_g"] = {"FPD": 950}
        data["cases"][1]["posture"] = "hok"
        data["cases"][2]["location"] = "wrist"

    report = examined(tmp_path, change)
    lines = [f.text for f in report.errors if f.code == "session"]
    assert len(lines) == 3
    assert "Did you mean FDP?" in lines[0]
    assert "constant_channel" in codes(report, "error")
    assert "saturation_skipped" not in codes(report, "note")  # the cell is stated


@pytest.mark.parametrize("name", ["nowhere", "synek2019_H1"])
def test_an_absent_session_is_a_finding(name: str) -> None:
    report = check(name)
    assert not report.ok
    assert report.errors[0].code == "session"


def test_bad_yaml_is_a_finding(tmp_path: Path) -> None:
    (tmp_path / "session.yaml").write_text("a: [1\n")
    assert "not YAML" in check(tmp_path).errors[0].text


def test_known_weights_are_reported(tmp_path: Path) -> None:
    report = examined(tmp_path)
    weights = report.as_dict()["known_weights"]
    assert [w["when"] for w in weights] == ["before", "after"]
    assert weights[0]["gain"] == pytest.approx(1.0, abs=0.01)
    assert weights[0]["axis"] == "-y"
    assert "weight" in codes(report, "note")


def test_the_answer_is_plain_data(tmp_path: Path) -> None:
    answer = examined(tmp_path).as_dict()
    json.dumps(answer, allow_nan=False)
    assert answer["schema"] == "fingertwin/check/1"
    assert answer["recording"]["readings"] == 4800
    assert answer["recording"]["rate_hz"] == pytest.approx(100.0)
    assert answer["tares"]["tares"] == 4
    answer = check("synek2019_H01").as_dict()
    json.dumps(answer, allow_nan=False)
    assert answer["ok"] is True


def test_averaged_sessions_need_no_readings(tmp_path: Path) -> None:
    report = check(save(tmp_path / "S1", averaged()))
    assert report.ok
    assert report.warnings == ()
