"""What would settle an error of the rig or a fault of the session; an effect says it of itself, as `shown_by`."""

from __future__ import annotations

# By the group of the budget's parameter; {} is the place in its name.
_RIG = {
    "zero": "tare the {} mount again",
    "mounting_rotation": "hang a known weight on the cell at the {} in three directions",
    "mount_offset": "measure where the cell's origin lies at the {}",
    "cell_gain": "hang a known weight on the cell along {}",
    "posture_angle": "measure the joint angles of {} again",
    "tension_factor": "pull a known weight through the pulley of {}",
}
# By the kind of a fault of the whole session.
FAULT_REMEDY = {
    "tendon_labels": "hang one of these tendons again",
    "rows": "compare the entries with the notebook, row by row",
    "side": "look which hand it is",
    "posture": "measure the joint angles again",
    "mount": "look up at which mount the cell was",
    "mass_unit": "weigh one of the weights",
    "axes": "hang a known weight along each axis of the cell",
    "unit": "hang a known weight on the cell",
    "gain": "hang a known weight on the cell at both mounts",
    "weight": "weigh the weights again, and see that they hang free",
    "tension": "look at that tendon's line, and measure its first load cases again",
    "tare": "look whether the recording was tared already",
    "zero": "tare the cell, and measure these cases again",
    "tare_weight": "measure these cases again after a tare with nothing hanging",
}


def rig_remedy(name: str) -> str:
    """What measurement would settle an error of the rig, such as `zero.bone.z`."""
    group, place = (*name.split("."), "")[:2]
    if name == "tension_factor.common":
        return "pull a known weight through every pulley"
    return _RIG.get(group, "measure it again").format(place.replace("#", ", setting ").replace("_", " "))
