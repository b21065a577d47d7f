"""Build `fingers/synek2019_bonobo.yaml`: the human normative points scaled to the bonobo's published numbers.

The bonobo's own tendon points (Article S3 of Synek et al. 2019) are not among the published data at hand. Its phalanx
lengths and the mean flexor moment arms of its optimised model are (Table 3). So the human points are scaled by bone
length, FDP and FDS are moved dorsally or palmarly until their mean moment arms over the four postures are as published,
and the priors are three times as wide.

    python data/build_bonobo.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_document, read_finger, write_finger
from fingermodel.scaling import match_moment_arms, renamed, scale_to_bones

LENGTHS_MM = {"DP": 20.4, "MP": 38.1, "PP": 57.8}
HUMAN_MM = {"DP": 19.02, "MP": 28.83, "PP": 47.02}
MEAN_ARMS_MM = {"DIP.FDP": 3.9, "PIP.FDP": 10.4, "MCP.FDP": 12.9, "PIP.FDS": 6.6, "MCP.FDS": 13.3}
# DIP, PIP, MCP flexion; the minor flexion that was done and computed has the PIP at 55 degrees.
POSTURES_DEG = ((40, 50, 60), (35, 55, 40), (50, 65, 0), (45, 50, -20))
# The interossei split into hood and phalanx as the weights hung on their two sutures (Table 1).
HOOD_SHARE = {"RI_EM": 200 / 550, "UI_EM": 200 / 400}


def build() -> Finger:
    """Scale, match and rename the human finger."""
    human = read_finger("synek2019_initial")
    rotations = human.topology.rotations
    postures = [
        np.deg2rad([{"DIP": d, "PIP": p, "MCP": m}.get(name, 0.0) for name in rotations]) for d, p, m in POSTURES_DEG
    ]
    finger = scale_to_bones(human, LENGTHS_MM, HUMAN_MM)
    finger = match_moment_arms(finger, MEAN_ARMS_MM, postures)
    fraction = finger.values.fraction.copy()
    for name, share in HOOD_SHARE.items():
        fraction[human.topology.fractions.index(name)] = share
    finger = finger.replace_values(fraction=fraction)
    title = "Bonobo third digit, from published bone lengths and moment arms (Synek et al. 2019)"
    return renamed(finger, "synek2019_bonobo", title, prior_width=3.0)


def main() -> None:
    """Write the file beside the other fingers."""
    cite = "human points of an1979 scaled to Table 3 of Synek et al. 2019 by data/build_bonobo.py"
    document = finger_document(build(), "scaled", cite, "low")
    for name, share in HOOD_SHARE.items():
        # Fixed at what the two sutures say, as the published identification does for the human finger.
        entry = document["hood"]["fractions"][name]
        entry.pop("centre", None)
        entry |= {"value": share, "sd": 0.0, "source": "synek2019", "certainty": "high"}
        entry["note"] = "ratio of the weights on its two sutures (Table 1)"
    heading = (
        "Made by `python data/build_bonobo.py`: do not edit.\n"
        "Points are in units of the human O2O3; proximal from the joint centre, distal from the concave base."
    )
    write_finger(document, Path(__file__).parent / "fingers" / "synek2019_bonobo.yaml", heading)


if __name__ == "__main__":
    main()
