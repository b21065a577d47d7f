"""Random finger chains as MuJoCo and OpenSim have them, with wraps on every side: files, and the engine's own word."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fingermodel.exchange.joint_heads import FLEXION_RANGE
from tests.fingermodel.exchanged import MM, Floats, required

ANGLES = ("q1", "q2", "q3")
TENDONS = tuple(f"{side}{joint}" for joint in (1, 2, 3) for side in ("palmar", "dorsal"))
# What a wrap may be: where its cylinder lies, its size, and the side that it holds the tendon on.
_QUADRANTS = ("all", "+y", "-y", "+x", "-x")


def _text(values: Floats) -> str:
    return " ".join(f"{x:.6f}" for x in np.asarray(values) / MM)


def _drawn(rng: np.random.Generator) -> dict[str, Any]:
    """Three hinges about z; flexor and extensor over each, with a cylinder of their own near the joint."""
    lengths = rng.uniform(20.0, 45.0, 3)
    tendons = []
    for joint in range(3):
        for sign in (-1.0, 1.0):
            aside = rng.choice([0.0, 0.0, rng.uniform(-3.0, 3.0)])
            back = [-rng.uniform(8.0, 18.0), sign * rng.uniform(3.0, 9.0), aside]
            ahead = [
                rng.uniform(8.0, 18.0),
                sign * rng.uniform(3.0, 9.0),
                aside + rng.choice([0.0, rng.uniform(-2, 2)]),
            ]
            off = [0.0, 0.0, 0.0] if rng.random() < 0.75 else [*rng.uniform(-2.0, 2.0, 2), 0.0]
            tilt = 0.0 if rng.random() < 0.85 else rng.uniform(-0.3, 0.3)
            kind = rng.choice(["cylinder", "cylinder", "cylinder", "sphere"])
            side = int(rng.integers(4))
            tendons.append((joint, sign, back, ahead, off, tilt, kind, rng.uniform(2.0, 9.0), side, rng.random() < 0.5))
    return {"lengths": lengths, "tendons": tendons}


def mjcf_chain(rng: np.random.Generator) -> str:
    """An MJCF chain."""
    drawn = _drawn(rng)
    inside: list[list[str]] = [[], [], [], []]
    paths = []
    for name, (joint, sign, back, ahead, off, tilt, kind, radius, side, on_child) in zip(
        TENDONS, drawn["tendons"], strict=True
    ):
        end = np.array([drawn["lengths"][joint - 1] if joint else 0.0, 0.0, 0.0])
        inside[joint].append(f'<site name="{name}a" pos="{_text(end + back)}"/>')
        inside[joint + 1].append(f'<site name="{name}b" pos="{_text(np.array(ahead))}"/>')
        holder, base = (joint + 1, np.zeros(3)) if on_child else (joint, end)
        turn = f'euler="{tilt:.6f} 0 0"'
        size = f"{radius / MM:.6f} 0.01" if kind == "cylinder" else f"{radius / MM:.6f}"
        place = _text(base + off)
        inside[holder].append(f'<geom name="{name}w" type="{kind}" size="{size}" pos="{place}" {turn} mass="0.001"/>')
        sides = ("", f"0 {2 * sign * radius}", f"0 {-2 * sign * radius}", f"0 {0.4 * sign * radius}")
        text = ""
        if sides[side]:
            at = base + off + np.array([*map(float, sides[side].split()), 0.0])
            inside[holder].append(f'<site name="{name}s" pos="{_text(at)}"/>')
            text = f' sidesite="{name}s"'
        path = f'<site site="{name}a"/><geom geom="{name}w"{text}/><site site="{name}b"/>'
        paths.append(f'<spatial name="{name}">{path}</spatial>')
    inside[3].append(f'<site name="load_point" pos="{_text(np.array([drawn["lengths"][2], 0.0, 0.0]))}"/>')
    bodies = ""
    for joint in (2, 1, 0):
        at = np.array([drawn["lengths"][joint - 1] if joint else 0.0, 0.0, 0.0])
        shape = '<geom type="sphere" size="0.001"/>'
        own = "".join(inside[joint + 1])
        hinge = f'<joint name="{ANGLES[joint]}" axis="0 0 -1"/>'
        bodies = f'<body name="b{joint + 1}" pos="{_text(at)}">{hinge}{shape}{own}{bodies}</body>'
    world = "".join(inside[0])
    return (
        f'<mujoco model="drawn"><compiler angle="radian"/><worldbody>{world}{bodies}</worldbody>'
        f"<tendon>{''.join(paths)}</tendon></mujoco>"
    )


def osim_chain(rng: np.random.Generator) -> str:
    """An OpenSim chain."""
    drawn = _drawn(rng)
    frames = ["/ground", *(f"/bodyset/b{i}" for i in (1, 2, 3))]
    shapes: list[list[str]] = [[], [], [], []]
    forces = []
    for name, (joint, _, back, ahead, off, tilt, kind, radius, side, on_child) in zip(
        TENDONS, drawn["tendons"], strict=True
    ):
        end = np.array([drawn["lengths"][joint - 1] if joint else 0.0, 0.0, 0.0])
        holder, base = (joint + 1, np.zeros(3)) if on_child else (joint, end)
        tag = "WrapCylinder" if kind == "cylinder" else "WrapSphere"
        quadrant = _QUADRANTS[(side + joint) % len(_QUADRANTS)]
        shapes[holder].append(
            f'<{tag} name="{name}w"><active>true</active><xyz_body_rotation>{tilt:.6f} 0 0</xyz_body_rotation>'
            f"<translation>{_text(base + off)}</translation><quadrant>{quadrant}</quadrant>"
            f"<radius>{radius / MM:.6f}</radius><length>0.06</length></{tag}>"
        )
        points = "".join(
            f'<PathPoint name="{name}{k}"><socket_parent_frame>{frames[f]}</socket_parent_frame>'
            f"<location>{_text(np.asarray(p))}</location></PathPoint>"
            for k, f, p in (("a", joint, end + back), ("b", joint + 1, ahead))
        )
        wrap = f'<PathWrap name="{name}p"><wrap_object>{name}w</wrap_object><method>hybrid</method></PathWrap>'
        forces.append(
            f'<PathActuator name="{name}"><GeometryPath name="path"><PathPointSet><objects>{points}</objects>'
            f"</PathPointSet><PathWrapSet><objects>{wrap}</objects></PathWrapSet></GeometryPath></PathActuator>"
        )
    wraps = [f"<WrapObjectSet><objects>{''.join(own)}</objects></WrapObjectSet>" for own in shapes]
    bodies = "".join(
        f'<Body name="b{i}"><mass>0.01</mass><mass_center>0 0 0</mass_center><inertia>1e-6 1e-6 1e-6 0 0 0</inertia>'
        f"{wraps[i]}</Body>"
        for i in (1, 2, 3)
    )
    joints = ""
    for i in range(3):
        at = np.array([drawn["lengths"][i - 1] if i else 0.0, 0.0, 0.0])
        frame = f"<socket_parent>{frames[i]}</socket_parent><translation>{_text(at)}</translation>"
        turned = "<orientation>3.14159265358979312 0 0</orientation>"
        child = f"<socket_parent>{frames[i + 1]}</socket_parent>{turned}"
        joints += (
            f'<PinJoint name="j{i + 1}"><socket_parent_frame>p</socket_parent_frame>'
            f'<socket_child_frame>c</socket_child_frame><coordinates><Coordinate name="{ANGLES[i]}"/></coordinates>'
            f'<frames><PhysicalOffsetFrame name="p">{frame}{turned}</PhysicalOffsetFrame>'
            f'<PhysicalOffsetFrame name="c">{child}</PhysicalOffsetFrame></frames></PinJoint>'
        )
    tip = _text(np.array([drawn["lengths"][2], 0.0, 0.0]))
    marker = (
        f'<Marker name="load_point"><socket_parent_frame>{frames[3]}</socket_parent_frame><location>{tip}</location>'
    )
    return (
        f'<OpenSimDocument Version="40600"><Model name="drawn"><Ground name="ground">{wraps[0]}</Ground>'
        f"<BodySet><objects>{bodies}</objects></BodySet><JointSet><objects>{joints}</objects></JointSet>"
        f"<ForceSet><objects>{''.join(forces)}</objects></ForceSet><MarkerSet><objects>{marker}</Marker></objects>"
        "</MarkerSet></Model></OpenSimDocument>"
    )


def postures_drawn(rng: np.random.Generator, count: int) -> Floats:
    """Postures (count, 3) [rad]."""
    return rng.uniform(*FLEXION_RANGE, (count, len(ANGLES)))


def arms_in_mujoco(text: str, postures: Floats) -> Floats:
    """What MuJoCo says of the whole file: (n, angles, tendons) [mm]."""
    mujoco = required("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    out = np.zeros((*postures.shape, len(TENDONS)))
    for posture, arms in zip(postures, out, strict=True):
        data.qpos[:] = posture
        mujoco.mj_forward(model, data)
        rate = np.zeros((model.ntendon, model.nv))
        rate[np.repeat(np.arange(model.ntendon), model.ten_J_rownnz), model.ten_J_colind] = data.ten_J
        arms[:] = -rate.T * MM
    return out


def arms_in_opensim(path: Path, postures: Floats) -> Floats:
    """What OpenSim says of the whole file: (n, angles, tendons) [mm]."""
    opensim = required("opensim")
    opensim.Logger.removeFileSink()
    opensim.Logger.setLevelString("Off")
    model = opensim.Model(str(path))
    state = model.initSystem()
    forces, coordinates = model.getForceSet(), [model.getCoordinateSet().get(name) for name in ANGLES]
    paths = [opensim.PathActuator.safeDownCast(forces.get(name)) for name in TENDONS]
    out = np.zeros((*postures.shape, len(TENDONS)))
    for posture, arms in zip(postures, out, strict=True):
        for coordinate, angle in zip(coordinates, posture, strict=True):
            coordinate.setValue(state, float(angle), False)
        model.realizePosition(state)
        arms[:] = [[path.computeMomentArm(state, coordinate) * MM for path in paths] for coordinate in coordinates]
    return out
