"""What measurement besides a load case would show an effect, by the effect's name."""

from __future__ import annotations

INSTRUMENTS = {
    "hanger_mass": "weigh the hangers",
    "rig_friction": "pull a known weight through the pulleys, or read the bone's clamp",
    "worn_pulley": "pull a known weight through that pulley",
    "goniometer_bias": "measure the joint angles again, with another instrument",
    "cell_rotation": "hang a known weight on the cell in three directions",
    "cell_crosstalk": "hang a known weight on the cell in three directions",
    "zero_offset": "read the unloaded cell before and after, at that mount",
    "tare_drift": "tare again before each case",
    "segment_length": "measure the bones in an X-ray",
    "tip_location": "measure where the clamp holds the pulp",
    "suture_angle": "photograph the sutures against the metacarpal",
    "clamp_compliance": "measure the joint angles with the weight on",
    "joint_friction": "read the bone's clamp as well",
}
