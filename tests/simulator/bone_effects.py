"""What may be otherwise in the skeleton and its joints: the catalogue from the posture to the joint torques.

Each is a form of our own: `Otherwise` says how it departs from the plain one.
"""

from __future__ import annotations

import numpy as np

from tests.simulator.finger import BONES, FLEXIONS, JOINTS, Floats, turning
from tests.simulator.situation import CATALOGUE, Situation

# Where an axis tilts: mostly in the frontal plane (about the dorsal axis), a little about the bone.
TILTS_ABOUT = np.array([0.2, 0.98, 0.0])


@CATALOGUE.enter("posture", "deg", -12.0, 12.0, JOINTS)
def goniometer_bias(s: Situation, size: Floats, shape: Floats) -> None:
    """Each joint angle is read wrong by a constant.

    Otherwise: nothing; there is but one way to be wrong by a constant.
    """
    s.angles = s.angles.copy()
    s.angles[FLEXIONS] += np.deg2rad(size)


@CATALOGUE.enter("geometry", "1", -0.15, 0.15, BONES)
def segment_length(s: Situation, size: Floats, shape: Floats) -> None:
    """Bones longer or shorter by a share of their length.

    Otherwise: not scaled as a whole: a head moves with the tendon points beside it, those at a base stretch half as
    much, and the distal phalanx grows to its clamp only.
    """
    f = s.finger
    grown = np.vstack([np.zeros(3), f.centre[1] * size[0], f.centre[2] * size[1]])
    f.centre = f.centre + grown
    f.proximal = f.proximal + grown[f.joint]
    f.distal = f.distal * np.column_stack([1.0 + 0.5 * size[f.joint], np.ones((len(f.joint), 2))])
    f.load_point = f.load_point * np.array([1.0 + size[2], 1.0, 1.0])


@CATALOGUE.enter("geometry", "mm", -6.0, 6.0)
def tip_location(s: Situation, size: Floats, shape: Floats) -> None:
    """The clamp holds the tip proximal (positive) or distal of the modelled point.

    Otherwise: along the pulp, which is round (radius 15 mm): it also goes dorsal.
    """
    arc = size[0] / 15.0
    s.finger.load_point = s.finger.load_point + 15.0 * np.array([np.sin(arc), 1.0 - np.cos(arc), 0.0])


@CATALOGUE.enter("geometry", "deg", -15.0, 15.0, JOINTS)
def axis_tilt(s: Situation, size: Floats, shape: Floats) -> None:
    """Flexion axes are not parallel.

    Otherwise: in a plane that is itself a few degrees off the frontal one.
    """
    about = TILTS_ABOUT / np.linalg.norm(TILTS_ABOUT)
    s.finger.flexion_axis = np.array(
        [turning(np.deg2rad(a) * about) @ axis for a, axis in zip(size, s.finger.flexion_axis, strict=True)]
    )


@CATALOGUE.enter("geometry", "mm/rad", -5.0, 5.0, JOINTS)
def centre_migration(s: Situation, size: Floats, shape: Floats) -> None:
    """A joint's centre moves along the bone before it with flexion, as where one bone rolls on the other.

    Otherwise: along an arc round the head, sin θ proximal and 1 - cos θ palmar.
    """
    theta = s.angles[FLEXIONS]
    arc = np.column_stack([np.sin(theta), np.cos(theta) - 1.0, np.zeros(3)])
    s.finger.centre = s.finger.centre + size[:, None] * arc


@CATALOGUE.enter("geometry", "mm", 0.0, 9.0)
def lateral_band_slip(s: Situation, size: Floats, shape: Floats) -> None:
    """The lateral bands drop palmar as the PIP flexes, by `size` at 90°.

    Otherwise: with 1 - cos θ, so late, and the ulnar band 10 % less than the radial one or more.
    """
    drop = size[0] * (1.0 - np.cos(max(float(s.angles[2]), 0.0)))
    uneven = 0.1 * shape[0]
    s.move(s.finger.of("RB"), np.array([0.0, -drop * (1.0 + uneven), 0.0]))
    s.move(s.finger.of("UB"), np.array([0.0, -drop * (1.0 - uneven), 0.0]))


@CATALOGUE.enter("geometry", "mm/N", 0.0, 0.8)
def bowstringing(s: Situation, size: Floats, shape: Floats) -> None:
    """The flexor tendons lift off the bone under the pulley load 2 T sin(θ/2).

    Otherwise: pulleys stiffen: the lift saturates (tanh) at 9 mm; and FDS under FDP lifts the pulley that both share,
    so a fifth of the other tendon's load counts.
    """
    flexors = s.pull[[3, 4]]
    theta = np.maximum(s.angles[FLEXIONS], 0.0)
    for slip, load in (("FDP", flexors[0] + 0.2 * flexors[1]), ("FDS", flexors[1] + 0.2 * flexors[0])):
        lift = 9.0 * np.tanh(size[0] * 2.0 * load * np.sin(0.5 * theta) / 9.0)
        s.move(s.finger.of(slip), -lift[s.finger.joint][:, None] * np.array([0.0, 1.0, 0.0]))


@CATALOGUE.enter("geometry", "mm", 0.0, 10.0)
def intrinsic_bowstring(s: Situation, size: Floats, shape: Floats) -> None:
    """Dissected intrinsics lift palmar at the flexed MCP, by `size` at 90°.

    Otherwise: with sin² θ, and the point on the phalanx follows by three quarters only.
    """
    lift = size[0] * np.sin(max(float(s.angles[0]), 0.0)) ** 2
    chosen = s.finger.of("RI", "LU", "UI", joint="MCP")
    s.move(chosen, np.array([0.0, -lift, 0.0]), "proximal")
    s.move(chosen, np.array([0.0, -0.75 * lift, 0.0]), "distal")


@CATALOGUE.enter("torque", "1", 0.0, 1.0)
def volar_plate(s: Situation, size: Floats, shape: Floats) -> None:
    """In hyperextension the palmar plate takes a share of an extending MCP torque.

    Otherwise: it tightens over a few degrees about 6° of hyperextension instead of at once.
    """
    tight = 0.5 * (1.0 + np.tanh((-s.angles[0] - np.deg2rad(6.0)) / np.deg2rad(4.0)))
    if s.torque[0] < 0.0:
        s.torque = s.torque * np.array([1.0 - size[0] * tight, 1.0, 1.0, 1.0])


@CATALOGUE.enter("torque", "1", 0.0, 0.3, JOINTS)
def joint_friction(s: Situation, size: Floats, shape: Floats) -> None:
    """Soft tissue beside a yielding clamp takes a share of each joint's torque.

    Otherwise: on a small Coulomb floor of up to 1 N mm, which is much of what is lost of a light load; abduction loses
    half the share that the MCP's flexion does.
    """
    share = size[[0, 0, 1, 2]] * np.array([1.0, 0.5, 1.0, 1.0])
    s.torque = (1.0 - share) * (s.torque - 5.0 * share * np.tanh(s.torque / 5.0))


@CATALOGUE.enter("give", "rad/(N mm)", 0.0, 3e-3, JOINTS)
def clamp_compliance(s: Situation, size: Floats, shape: Floats) -> None:
    """The clamped joint gives under torque, so the posture depends on the load.

    Otherwise: its spring stiffens: the give saturates (tanh) with 200 N mm.
    """
    s.give = s.give.copy()
    s.give[FLEXIONS] += size * 200.0 * np.tanh(s.torque[FLEXIONS] / 200.0)
