"""What others' files wrap on: read as the engine has it, or said with the error that is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from daq.errors import ModelError
from fingermodel.exchange.arm_formulas import formula_arms
from fingermodel.exchange.described import Imported
from fingermodel.exchange.joint_heads import NOTHING_MM
from fingermodel.exchange.mjcf import write_mjcf
from fingermodel.exchange.osim import write_osim
from fingermodel.exchange.read_mjcf import read_mjcf
from fingermodel.exchange.read_osim import read_osim
from fingermodel.fingers.files import finger_from_dict
from fingermodel.model import posture_moment_arms
from tests.fingermodel.exchanged import Floats, finger_called, postures, required
from tests.fingermodel.foreign_chains import (
    TENDONS,
    arms_in_mujoco,
    arms_in_opensim,
    mjcf_chain,
    osim_chain,
    postures_drawn,
)

ANGLES = np.array([[-0.4], [0.0], [0.5]])


def one_joint(wrap: str = "", radius: float = 0.01, side: str = "0 -0.02 0") -> str:
    return f"""<mujoco model="one joint">
  <worldbody>
    <site name="a" pos="-0.03 -0.008 0"/>
    <site name="side" pos="{side}"/>
    <geom name="head" type="cylinder" fromto="0 0 -0.01 0 0 0.01" size="{radius}"/>
    <body name="phalanx">
      <joint name="pip" axis="0 0 -1"/>
      <geom type="capsule" fromto="0 0 0 0.04 0 0" size="0.004"/>
      <site name="b" pos="0.03 -0.008 0"/>
      <site name="load_point" pos="0.04 0 0"/>
    </body>
  </worldbody>
  <tendon><spatial name="flexor"><site site="a"/>{wrap}<site site="b"/></spatial></tendon>
</mujoco>"""


def imported(text: str, folder: Path, kind: str = "xml") -> Imported:
    path = folder / f"theirs.{kind}"
    path.write_text(text, encoding="utf-8")
    return (read_mjcf if kind == "xml" else read_osim)(path, "a test")


def arms(found: Imported) -> Floats:
    return formula_arms(found.finger, ANGLES)[:, 0, 0]


WRAP = '<geom geom="head"/>'
SIDED = '<geom geom="head" sidesite="side"/>'


# Right are MuJoCo's dL/dq at -0.4, 0 and 0.5 rad.
@pytest.mark.parametrize(
    ("text", "right"),
    [
        (one_joint(SIDED), [10.0, 10.0, 15.173418]),
        (one_joint(SIDED, 0.008), [8.0, 8.0, 15.173418]),
        (one_joint(WRAP, 0.009), [9.0, 9.0, 15.173418]),
        (one_joint(SIDED, 0.008, "0 0.02 0"), [-8.0, -8.0, -8.0]),
        (one_joint(), [1.880453, 8.0, 15.173418]),
    ],
)
def test_a_cylinder_about_the_joint_is_an_angle_of_rest(text: str, right: list[float], tmp_path: Path) -> None:
    assert_allclose(arms(imported(text, tmp_path)), right, rtol=0, atol=1e-6)


def test_a_tendon_held_inside_is_said_to_be_off_and_by_how_much(tmp_path: Path) -> None:
    text = one_joint(SIDED, 0.008, "0 -0.004 0")
    found = imported(text, tmp_path)
    held, off = found.notes[-2:]
    assert held == "pip.flexor: wraps on a cylinder that holds it inside: taken as straight"
    assert found.check is not None
    worst = found.check.worst_mm["flexor"]
    assert f"up to {worst:.2g} mm" in off or f"up to {worst * 1.05:.2g} mm" in off
    assert worst > np.abs(arms(found) - [1.880453, 8.0, 7.733]).max()


def test_repeated_sections_are_merged_as_mujoco_does(tmp_path: Path) -> None:
    plain = imported(one_joint(), tmp_path).finger
    defaults = '<default><joint axis="0 0 -1"/></default><default><site size="0.001"/></default><worldbody>'
    twice = one_joint().replace('axis="0 0 -1"', "").replace("<worldbody>", defaults)
    apart = one_joint().replace("<body ", "</worldbody><worldbody><body ")
    framed = (
        one_joint().replace("<worldbody>", '<worldbody><frame euler="10 20 30">').replace("</world", "</frame></world")
    )
    for text in (twice, apart, framed):
        found = imported(text, tmp_path)
        assert_allclose(formula_arms(found.finger, ANGLES), formula_arms(plain, ANGLES), rtol=0, atol=1e-9)


def test_looks_and_masses_do_not_matter(tmp_path: Path) -> None:
    looks = '<asset><mesh name="m" file="away.stl"/><material name="x"/></asset><worldbody><light pos="0 0 1"/>'
    text = (
        one_joint()
        .replace("<worldbody>", looks)
        .replace("<geom type", '<geom type="mesh" mesh="m"/><geom material="x" type')
    )
    assert_allclose(arms(imported(text, tmp_path)), [1.880453, 8.0, 15.173418], rtol=0, atol=1e-6)


OSIM = (Path(__file__).parent / "exchange_theirs.osim").read_text(encoding="utf-8")
STILL = '<Constant name="function">\n                <value>0</value>\n              </Constant>'


@pytest.mark.parametrize(
    "function",
    [
        f"<MultiplierFunction name='function'><function>{STILL}</function><scale>1.1</scale></MultiplierFunction>",
        "<SimmSpline name='function'><x>-1 0 1</x><y>0 0 0</y></SimmSpline>",
    ],
)
def test_what_the_scale_tool_leaves_of_a_joint_is_read(function: str, tmp_path: Path) -> None:
    assert OSIM.count(STILL) >= 3
    plain, scaled = (imported(text, tmp_path, "osim").finger for text in (OSIM, OSIM.replace(STILL, function)))
    q = postures_drawn(np.random.default_rng(1), 9)
    assert_allclose(formula_arms(scaled, q), formula_arms(plain, q), rtol=0, atol=1e-12)


def test_what_is_not_read_is_said(tmp_path: Path) -> None:
    read = imported(OSIM, tmp_path, "osim").read
    assert "hinges 3" in read
    assert read.endswith("not read: length of WrapCylinder")


def test_without_opensim_nothing_is_said_to_be_held_against_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fingermodel.exchange.read_osim.installed", lambda: False)
    found = imported(OSIM, tmp_path, "osim")
    assert found.check is None
    assert found.notes[-1] == "moment arms were not held against OpenSim's: it is not installed"


def test_a_multiplier_that_moves_a_joint_is_refused(tmp_path: Path) -> None:
    moved = STILL.replace(">0<", ">0.2<")
    text = OSIM.replace(STILL, f"<MultiplierFunction><function>{moved}</function><scale>2</scale></MultiplierFunction>")
    with pytest.raises(ModelError, match=r"is moved by 0\.4"):
        imported(text.replace("<MultiplierFunction>", '<MultiplierFunction name="function">'), tmp_path, "osim")


def test_an_export_that_opensim_scaled_comes_back_scaled(tmp_path: Path) -> None:
    opensim = required("opensim")
    opensim.Logger.removeFileSink()
    finger = finger_called("an1979_middle")
    (tmp_path / "out.osim").write_text(write_osim(finger, "test").text, encoding="utf-8")
    model = opensim.Model(str(tmp_path / "out.osim"))
    state = model.initSystem()
    scales = opensim.ScaleSet()
    for name in ("ground", *finger.topology.bones):
        scale = opensim.Scale()
        scale.setSegmentName(name)
        scale.setScaleFactors(opensim.Vec3(1.1, 1.1, 1.1))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    assert model.scale(state, scales, True, -1.0)
    assert model.printToXML(str(tmp_path / "scaled.osim"))
    found = read_osim(tmp_path / "scaled.osim", "a test")
    q = postures(finger, 1, 5)
    assert_allclose(formula_arms(found.finger, q), 1.1 * formula_arms(finger, q), rtol=0, atol=1e-9)
    assert "Scale Tool left the formulas of PIP.ES" in found.notes[-1]


@pytest.mark.parametrize("kind", ["xml", "osim"])
def test_a_random_chain_has_the_engines_moment_arms_or_says_what_is_off(kind: str, tmp_path: Path) -> None:
    required("mujoco" if kind == "xml" else "opensim")
    exact = 0
    for seed in range(8 if kind == "xml" else 3):
        rng = np.random.default_rng(seed)
        text = (mjcf_chain if kind == "xml" else osim_chain)(rng)
        found = imported(text, tmp_path, kind)
        assert found.check is not None
        q = postures_drawn(rng, 60)
        theirs = arms_in_mujoco(text, q) if kind == "xml" else arms_in_opensim(tmp_path / "theirs.osim", q)
        slips = [s.slip for s in found.finger.topology.segments]
        ours = formula_arms(found.finger, q)[:, :, [slips.index(name) for name in TENDONS]]
        for name, off in zip(TENDONS, np.abs(theirs - ours).max(axis=(0, 1)), strict=True):
            said = any(note.startswith(f"{name}: its moment arms differ") for note in found.notes)
            assert said == (found.check.worst_mm[name] > NOTHING_MM)
            assert off <= NOTHING_MM or (said and off < 1.2 * found.check.worst_mm[name])
            exact += not said
    assert exact >= 1


# The angle of rest in our own model and files


@pytest.mark.parametrize("axes", [1, 2])
def test_a_line_rests_from_its_angle_on(axes: int, tmp_path: Path) -> None:
    """With one axis and with two: the formulas, the model, and our files for both engines agree."""
    document = imported(one_joint(SIDED), tmp_path).document
    (segment,) = document["segments"]
    assert segment["rests_at_deg"] == pytest.approx(7.7145, abs=1e-3)
    if axes == 2:
        rotations = [{"name": "spread", "axis": [0.0, 1.0, 0.0]}, *document["joints"][0]["rotations"]]
        document |= {"joints": [{**document["joints"][0], "rotations": rotations}], "reactions": ["Fx", "Fy"]}
    rested = finger_from_dict(document, "a test")
    q = np.random.default_rng(1).uniform(-0.3, 0.6, (6, axes))
    expected = formula_arms(rested, q)
    for row, arms_there in zip(q, expected, strict=True):
        assert_allclose(posture_moment_arms(rested.topology, rested.values, row), arms_there, rtol=0, atol=1e-9)
    written = {"osim": write_osim(rested, "test")} | ({"xml": write_mjcf(rested, "test")} if axes == 1 else {})
    for kind, file in written.items():
        assert_allclose(formula_arms(imported(file.text, tmp_path, kind).finger, q), expected, rtol=0, atol=1e-9)
    with pytest.raises(ModelError, match="expected it with a wrap only"):
        finger_from_dict(document | {"segments": [{**segment, "wrap": "straight"}]}, "a test")
