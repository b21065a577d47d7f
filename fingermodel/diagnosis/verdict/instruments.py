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

# The same for errors of the rig, by the group of the budget's parameter; {} is the place in its name.
_RIG = {
    "zero": "tare the {} mount again",
    "mounting_rotation": "hang a known weight on the cell at the {} in three directions",
    "mount_offset": "measure where the cell's origin lies at the {}",
    "cell_gain": "hang a known weight on the cell along {}",
    "posture_angle": "measure the joint angles of {} again",
    "tension_factor": "pull a known weight through the pulley of {}",
}


def rig_remedy(name: str) -> str:
    """What measurement would settle an error of the rig, such as `zero.bone.z`."""
    group, place = (*name.split("."), "")[:2]
    if name == "tension_factor.common":
        return "pull a known weight through every pulley"
    return _RIG.get(group, "measure it again").format(place.replace("#", ", setting ").replace("_", " "))


def remedy(candidate: str) -> str | None:
    """What measurement besides a load case would show an effect or one of its candidates; None where none is known."""
    effect, _, place = candidate.partition(".")
    return rig_remedy(f"zero.{place}") if effect == "zero_offset" and place else INSTRUMENTS.get(effect)
