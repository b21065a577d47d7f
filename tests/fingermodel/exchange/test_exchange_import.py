"""Fingers read from OpenSim and MJCF files: ours come back the same, others' have the arms that they have there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from daq.errors import ModelError
from fingermodel.exchange.described import Imported
from fingermodel.exchange.mjcf import write_mjcf
from fingermodel.exchange.osim import write_osim
from fingermodel.exchange.read_mjcf import read_mjcf
from fingermodel.exchange.read_osim import read_osim
from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_names, read_finger, write_finger
from fingermodel.model import posture_moment_arms
from tests.fingermodel.exchanged import (
    Floats,
    InMujoco,
    InOpensim,
    finger_called,
    postures,
    required,
    tip_forces,
)

WRITERS = {"osim": write_osim, "mjcf": write_mjcf}
READERS = {"osim": read_osim, "mjcf": read_mjcf}
ENDING = {"osim": ".osim", "mjcf": ".xml"}
HERE = Path(__file__).parent
# Fingers as others make them: bodies' axes as they like, degrees, defaults, offsets, welded bodies, a cylinder.
FOREIGN_MJCF = (HERE / "exchange_theirs.xml").read_text(encoding="utf-8")
FOREIGN_OSIM = (HERE / "exchange_theirs.osim").read_text(encoding="utf-8")


def exported(finger: Finger, kind: str, folder: Path) -> Path:
    path = folder / f"finger{ENDING[kind]}"
    path.write_text(WRITERS[kind](finger, "test").text, encoding="utf-8")
    return path


def read(path: Path, load_point_mm: Floats | None = None) -> Imported:
    return READERS["osim" if path.suffix == ".osim" else "mjcf"](path, "a test", load_point_mm)


# What we exported


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("name", [*finger_names(), "fitted", "skew axes"])
def test_a_finger_comes_back(name: str, kind: str, tmp_path: Path) -> None:
    finger = finger_called(name)
    imported = read(exported(finger, kind, tmp_path))
    write_finger(imported.document, tmp_path / "again.yaml")
    again = read_finger(tmp_path / "again.yaml")
    assert imported.notes == ()
    assert again.topology == finger.topology
    assert (again.fraction_priors, again.prior_width) == (finger.fraction_priors, finger.prior_width)
    assert (again.length_unit_mm, again.judged_in) == (finger.length_unit_mm, finger.judged_in)
    posture = postures(finger, 1)
    tension = np.random.default_rng(2).uniform(0.0, 9.0, (len(posture), len(finger.topology.muscles)))
    assert_allclose(tip_forces(again, posture, tension), tip_forces(finger, posture, tension), rtol=0, atol=1e-8)
    for q in posture[:50]:
        assert_allclose(arms(again, q), arms(finger, q), rtol=0, atol=1e-11)


def test_a_finger_comes_back_from_a_file_that_opensim_saved(tmp_path: Path) -> None:
    opensim = required("opensim")
    finger = finger_called("synek2019_optimised")
    opensim.Logger.removeFileSink()
    model = opensim.Model(str(exported(finger, "osim", tmp_path)))
    model.initSystem()
    assert model.printToXML(str(tmp_path / "saved.osim"))
    again = read(tmp_path / "saved.osim").finger
    assert again.topology == finger.topology
    for q in postures(finger, 3)[:20]:
        assert_allclose(arms(again, q), arms(finger, q), rtol=0, atol=1e-9)


def test_a_moved_point_is_read_as_it_stands_in_the_file(tmp_path: Path) -> None:
    finger = finger_called("an1979_middle")
    path = exported(finger, "mjcf", tmp_path)
    text = path.read_text(encoding="utf-8")
    number = next(i for i, s in enumerate(finger.topology.segments) if s.name == "MCP.RI")
    at = " ".join(repr(float(x) * 1e-3) for x in finger.values.proximal_point[number])
    assert text.count(f'name="MCP.RI.proximal" pos="{at}"') == 1
    path.write_text(text.replace(f'name="MCP.RI.proximal" pos="{at}"', 'name="MCP.RI.proximal" pos="0.01 0.002 0.012"'))
    assert_allclose(read(path).finger.values.proximal_point[number], [10.0, 2.0, 12.0], rtol=0, atol=1e-12)


# What others made


def test_a_finger_of_another_program_has_the_moment_arms_that_mujoco_gives_it(tmp_path: Path) -> None:
    required("mujoco")
    path = tmp_path / "theirs.xml"
    path.write_text(FOREIGN_MJCF, encoding="utf-8")
    imported = read(path)
    finger = imported.finger
    topology = finger.topology
    assert topology.bones == ("metacarpal", "proximal", "middle")
    assert topology.rotations == ("spread", "mcp", "pip")
    assert topology.muscles == ("flexor", "side", "long", "ext")
    assert [s.name for s in topology.segments] == [
        "spread.flexor",
        "pip.flexor",
        "spread.side",
        "spread.long",
        "spread.ext",
    ]
    assert [topology.joints[i].flexion for i in range(2)] == [1, 0]
    assert any("bend towards the palm" in note for note in imported.notes)
    theirs = InMujoco(
        FOREIGN_MJCF.replace("<muscle ", "<motor "), topology.rotations, (), ["flexor", "side", "long", "ext"]
    )
    for q in np.random.default_rng(5).uniform(-0.6, 1.2, (60, 3)):
        answer = theirs.ask(q, np.zeros(0))
        whole = muscle_arms(finger, q)
        assert_allclose(whole, answer.moment_arms, rtol=0, atol=1e-9)


def test_their_axes_become_ours(tmp_path: Path) -> None:
    """x from the tip to the hand, z along the last axis; the load point lies where MuJoCo has it."""
    path = tmp_path / "theirs.xml"
    path.write_text(FOREIGN_MJCF, encoding="utf-8")
    finger = read(path).finger
    assert_allclose(finger.values.axis[2], [0.0, 0.0, 1.0], atol=1e-12)
    reach = finger.values.centre[1] + finger.values.load_point
    assert reach[0] < -40.0
    assert abs(reach[1]) < 1e-9


def test_a_finger_of_another_program_has_the_moment_arms_that_opensim_gives_it(tmp_path: Path) -> None:
    required("opensim")
    path = tmp_path / "theirs.osim"
    # The table that the reader of our own files wants.
    table = "<!--\n  flexor: 1.0 0.0\n  side: 0.0 1.0\n-->\n<OpenSimDocument"
    path.write_text(FOREIGN_OSIM.replace("<OpenSimDocument", table), encoding="utf-8")
    imported = read(path)
    topology = imported.finger.topology
    assert topology.bones == ("mc", "pp", "mp")
    assert topology.rotations == ("spread", "bend", "pip_bend")
    assert [s.name for s in topology.segments] == ["mcp.flexor", "pip.flexor", "mcp.side"]
    assert any("1 forces without a path" in note for note in imported.notes)
    theirs = InOpensim(path, topology.rotations, "mp", ["flexor", "side"])
    for q in np.random.default_rng(5).uniform(-0.6, 1.2, (40, 3)):
        whole = arms(imported.finger, q) @ np.array(
            [[s.slip == m for m in topology.muscles] for s in topology.segments]
        )
        assert_allclose(whole, theirs.ask(q, np.zeros(2)).moment_arms, rtol=0, atol=1e-9)


def test_a_load_point_can_be_given(tmp_path: Path) -> None:
    path = tmp_path / "theirs.osim"
    path.write_text(FOREIGN_OSIM, encoding="utf-8")
    stated = read(path).finger.values.load_point
    path.write_text(FOREIGN_OSIM.replace('"load_point"', '"another"'), encoding="utf-8")
    with pytest.raises(ModelError, match="--load-point 'X Y Z'"):
        read(path)
    given = read(path, np.array([25.0, 1.0, 2.0])).finger.values.load_point
    assert_allclose(given, stated, rtol=0, atol=1e-12)


def test_a_shape_that_is_no_joint_head_is_said_to_be_left_out(tmp_path: Path) -> None:
    wrap = "<PathWrap><wrap_object>head</wrap_object></PathWrap>"
    before, after = FOREIGN_OSIM.rsplit("</PathPointSet>", 1)
    path = tmp_path / "theirs.osim"
    path.write_text(
        f"{before}</PathPointSet><PathWrapSet><objects>{wrap}</objects></PathWrapSet>{after}", encoding="utf-8"
    )
    imported = read(path)
    assert any(
        note == "mcp.side: wraps on a cylinder that is not the head of its joint: taken as straight"
        for note in imported.notes
    )
    assert {s.wrap for s in imported.finger.topology.segments} == {"straight"}


# What is refused, in one line

Edit = Callable[[str], str]


def swapped(old: str, new: str, count: int = 1) -> Edit:
    def edit(text: str) -> str:
        assert text.count(old) >= 1
        return text.replace(old, new, count)

    return edit


def tip_on_pp(text: str) -> str:
    before, after = text.split('<Marker name="load_point">')
    return before + '<Marker name="load_point">' + after.replace("/bodyset/mp", "/bodyset/pp", 1)


def moving(text: str) -> str:
    return text.replace("<PathPoint ", "<MovingPathPoint ", 1).replace("</PathPoint>", "</MovingPathPoint>", 1)


REFUSED: list[tuple[str, Edit, str]] = [
    (FOREIGN_MJCF, swapped('name="pip"', 'name="pip" type="slide"'), "joint pip is of type slide; expected hinge"),
    (FOREIGN_MJCF, swapped('<joint name="pip"/>', '<joint name="pip" ref="5"/>'), "counts its angle from 5"),
    (FOREIGN_MJCF, swapped('<joint name="pip"/>', "<freejoint/>"), "free joint can only be used on top level"),
    (
        FOREIGN_MJCF,
        swapped('<body name="middle"', '<body name="x"><joint name="y"/></body><body name="middle"'),
        "is no chain: middle and x both move on proximal",
    ),
    (
        FOREIGN_MJCF,
        swapped('<joint name="spread" axis="1 0 0.1"/>', '<joint name="spread" axis="1 0 0.1" pos="0 0 0.01"/>'),
        "do not meet in a point",
    ),
    (
        FOREIGN_MJCF,
        swapped("<tendon>", '<equality><joint joint1="mcp" joint2="pip"/></equality><tendon>'),
        "ties joints or bodies together",
    ),
    (
        FOREIGN_MJCF,
        swapped('<site site="f2"/>', '<pulley divisor="2"/><site site="f2"/>'),
        "divides its tension at a pulley",
    ),
    (
        FOREIGN_MJCF,
        swapped('<site site="f1"/>', '<site site="nowhere"/>'),
        "MuJoCo refuses it (Error: site 'nowhere' not found",
    ),
    (
        FOREIGN_MJCF,
        swapped("0.041", "41"),
        "from the first joint to the load point it is 41.02 m; expected 0.01 to 0.5 m, lengths in metres",
    ),
    (FOREIGN_MJCF, swapped("0.008 0.001 0.035", "0.009 0.001 35"), "has a point"),
    (FOREIGN_MJCF, swapped('pos="0.008 0.001 0.035"', 'pos="0.008 nan 0.035"'), "holds a number that is not finite"),
    (FOREIGN_MJCF, swapped('pos="0.008 0.001 0.035"', 'pos="0.008 x 0.035"'), "bad format in attribute 'pos'"),
    (FOREIGN_MJCF, swapped('quat="0.9 0.1 -0.3 0.2"', 'quat="0 0 0 0"'), "zero quaternion is not allowed"),
    (FOREIGN_MJCF, swapped("<worldbody>", '<worldbody><replicate count="9"/>'), "uses <replicate>"),
    (FOREIGN_MJCF, swapped("<worldbody>", '<include file="/etc/passwd"/><worldbody>'), "uses <include>"),
    (FOREIGN_MJCF, swapped("<mujoco", '<!DOCTYPE mujoco [<!ENTITY a "b">]>\n<mujoco'), "declares its own markup"),
    (FOREIGN_MJCF, swapped('name="mcp"', 'name="pip"'), "repeated name 'pip' in joint"),
    (FOREIGN_MJCF, swapped('"e3"/></spatial>', '"e3"/><site site="e0"/></spatial>'), "crosses spread twice"),
    (FOREIGN_MJCF, swapped("mujoco", "robot", 9), "begins with <robot>"),
    (FOREIGN_MJCF, swapped("</worldbody>", ""), "is not XML"),
    (FOREIGN_OSIM, swapped("UniversalJoint", "BallJoint", 2), "joint mcp is a BallJoint; expected a PinJoint"),
    (FOREIGN_OSIM, swapped('Version="40000"', 'Version="30000"'), "has version 30000; expected 40000 or later"),
    (
        FOREIGN_OSIM,
        swapped("<BodySet", "<length_units>millimeters</length_units><BodySet"),
        "has length_units 'millimeters'; expected meters",
    ),
    (FOREIGN_OSIM, swapped("-1 0</coefficients>", "0.5 0</coefficients>"), "follows a LinearFunction of pip_bend"),
    (FOREIGN_OSIM, swapped("<value>0</value>", "<value>0.2</value>"), "is moved by 0.2"),
    (
        FOREIGN_OSIM,
        swapped("/bodyset/ring</socket_parent>", "/bodyset/mc</socket_parent>"),
        "is no chain: mp and pp both move on mc",
    ),
    (
        FOREIGN_OSIM,
        swapped(
            "<ForceSet", "<ConstraintSet><objects><CoordinateCouplerConstraint/></objects></ConstraintSet><ForceSet"
        ),
        "ties joints together",
    ),
    (FOREIGN_OSIM, moving, "point 1 of flexor is a MovingPathPoint; expected a PathPoint"),
    (
        FOREIGN_OSIM,
        swapped('<Coordinate name="pip_bend" />', '<Coordinate name="pip_bend"><locked>true</locked></Coordinate>'),
        "pip_bend is locked or prescribed",
    ),
    (FOREIGN_OSIM, swapped("0.04 0.003 0.002", "40 3 2"), "from the first joint to the load point"),
    (FOREIGN_OSIM, tip_on_pp, "load_point lies on pp"),
]


@pytest.mark.parametrize(("text", "edit", "said"), REFUSED)
def test_what_is_no_finger_is_refused_in_one_line(text: str, edit: Edit, said: str, tmp_path: Path) -> None:
    path = tmp_path / ("theirs.osim" if "OpenSimDocument" in text else "theirs.xml")
    path.write_text(edit(text), encoding="utf-8")
    with pytest.raises(ModelError) as refused:
        read(path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("kind", "edit", "said"),
    [
        ("mjcf", swapped('divisor="2.0"', 'divisor="3.0"'), "the pulleys of LU lead 0.333333 of its tension to DIP.TE"),
        ("mjcf", swapped("{&quot;format", "[&quot;format"), "the text that fingertwin wrote is damaged"),
        ("osim", swapped('"value": 0.5', '"value": 5'), "hood.fractions.RI_ES.value"),
        ("osim", swapped("max(q1, 0)", "max(q1, 1)"), "MCP.FDP is given by formulas that are not those of a tendon"),
        ("osim", swapped("cos(q1)", "(2)"), "PIP.ES is given by formulas that are not those of a tendon"),
        ("osim", swapped('<Marker name="PIP.ES.distal">', '<Marker name="other">'), "PIP.ES has no path points"),
    ],
)
def test_an_exported_file_that_was_changed_by_halves_is_refused(
    kind: str, edit: Edit, said: str, tmp_path: Path
) -> None:
    path = exported(finger_called("an1979_middle"), kind, tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(edit(text), encoding="utf-8")
    with pytest.raises(ModelError) as refused:
        read(path)
    assert said in str(refused.value)


@pytest.mark.parametrize("kind", ["osim", "mjcf", "theirs.osim", "theirs.xml"])
def test_a_damaged_file_is_read_or_refused_and_nothing_else(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # OpenSim is asked in another process, which no damage outlives.
    monkeypatch.setattr("fingermodel.exchange.read_osim.installed", lambda: False)
    if kind in WRITERS:
        path = exported(finger_called("synek2019_bonobo"), kind, tmp_path)
        whole = path.read_text(encoding="utf-8")
    else:
        path, whole = tmp_path / kind, FOREIGN_OSIM if kind.endswith("osim") else FOREIGN_MJCF
    rng = np.random.default_rng(7)
    begin = whole.index("<Model") if "<Model" in whole else whole.index("<mujoco")
    refused = 0
    for _ in range(150):
        at = int(rng.integers(begin, len(whole)))
        end = at + int(rng.integers(1, 12))
        put = str(rng.choice(["", "0", "-1e9", "x", "nan", '"', "null", "[]", "<a/>"]))
        path.write_text(whole[:at] + put + whole[end:], encoding="utf-8")
        message = refusal(path)
        assert message is None or "\n" not in message
        refused += message is not None
    assert refused > 50


def refusal(path: Path) -> str | None:
    try:
        read(path)
    except ModelError as error:
        return str(error)
    return None


def test_a_file_that_is_missing_empty_or_no_text_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"\xff\xfe\x00\x01", b"<a>" * 5):
        for name in ("x.osim", "x.xml"):
            (tmp_path / name).write_bytes(content)
            with pytest.raises(ModelError):
                read(tmp_path / name)
    with pytest.raises(ModelError, match=r"cannot be read \(No such file"):
        read(tmp_path / "absent.osim")


def test_the_finger_file_says_where_its_numbers_come_from(tmp_path: Path) -> None:
    document = read(exported(finger_called("an1979_middle"), "osim", tmp_path)).document
    assert yaml.safe_load(yaml.safe_dump(document)) == document
    assert document["sources"] == {"file": "a test"}
    assert {b["source"] for b in (*document["joints"], *document["segments"], document["load_point"])} == {"file"}


def arms(finger: Finger, posture: Floats) -> Floats:
    return np.asarray(posture_moment_arms(finger.topology, finger.values, posture))


def muscle_arms(finger: Finger, posture: Floats) -> Floats:
    topology = finger.topology
    return arms(finger, posture) @ np.array([[s.slip == m for m in topology.muscles] for s in topology.segments])
