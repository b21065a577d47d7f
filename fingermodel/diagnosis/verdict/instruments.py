"""What measurement would settle an error of the rig; an effect says it of itself, as `shown_by`."""

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


def rig_remedy(name: str) -> str:
    """What measurement would settle an error of the rig, such as `zero.bone.z`."""
    group, place = (*name.split("."), "")[:2]
    if name == "tension_factor.common":
        return "pull a known weight through every pulley"
    return _RIG.get(group, "measure it again").format(place.replace("#", ", setting ").replace("_", " "))
