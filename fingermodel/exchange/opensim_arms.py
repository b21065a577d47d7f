"""Moment arms as OpenSim itself has them, where it is installed.

A process of its own asks it: a file that OpenSim cannot bear ends that process, not this one.

    python -m fingermodel.exchange.opensim_arms MODEL.osim < what is asked, as JSON
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_PATIENCE_S = 120.0
_MM = 1000.0


class OpensimFailedError(Exception):
    """OpenSim did not answer."""


def installed() -> bool:
    """Whether OpenSim is there to be asked."""
    return find_spec("opensim") is not None


class OpensimArms:
    """A model in OpenSim, of which moment arms are asked.

    Args:
        root: the file's document.
    """

    def __init__(self, root: ET.Element) -> None:
        self._text = ET.tostring(_paths_only(root), encoding="unicode")

    def moment_arms(self, rotations: Sequence[str], tendons: Sequence[str], postures: Floats) -> Floats:
        """Of tendons in postures (n, rotations) [rad]: (n, rotations, tendons) [mm].

        Raises:
            OpensimFailedError: it cannot open the file, or is not done in two minutes.
        """
        asked = json.dumps({"rotations": list(rotations), "tendons": list(tendons), "postures": postures.tolist()})
        with TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True) as folder:
            file = Path(folder) / "model.osim"
            file.write_text(self._text, encoding="utf-8")
            try:
                done = subprocess.run(  # noqa: S603 - this interpreter and this module
                    [sys.executable, "-m", __name__, str(file)],
                    input=asked,
                    capture_output=True,
                    encoding="utf-8",
                    timeout=_PATIENCE_S,
                    check=False,
                )
                return np.array(json.loads(done.stdout.splitlines()[-1]), dtype=np.float64)
            except (subprocess.TimeoutExpired, OSError, ValueError, IndexError) as error:
                raise OpensimFailedError from error


def _paths_only(root: ET.Element) -> ET.Element:
    """Bodies, joints, shapes and paths: what moment arms hang on, and nothing that reads other files."""
    kept = ET.Element("OpenSimDocument", Version=root.get("Version", ""))
    model = ET.SubElement(kept, "Model", name="model")
    model.extend(part for part in root.findall("./Model/*") if part.tag in ("Ground", "BodySet", "JointSet"))
    objects = ET.SubElement(ET.SubElement(model, "ForceSet", name="forceset"), "objects")
    for force in root.findall("./Model/ForceSet/objects/*"):
        if (path := force.find("./GeometryPath")) is not None:
            # Whatever pulls, its path is the same.
            ET.SubElement(objects, "PathActuator", name=force.get("name", "")).append(path)
    for parent in model.iter():
        for part in list(parent):
            if part.tag in ("attached_geometry", "FrameGeometry", "Appearance", "components"):
                parent.remove(part)
    return kept


def main() -> None:
    """Answer one question: moment arms (n, rotations, tendons) [mm] as JSON on the last line of standard output."""
    opensim: Any = import_module("opensim")
    opensim.Logger.removeFileSink()
    opensim.Logger.setLevelString("Off")
    asked = json.load(sys.stdin)
    model = opensim.Model(sys.argv[1])
    state = model.initSystem()
    coordinates = [model.getCoordinateSet().get(name) for name in asked["rotations"]]
    forces = model.getForceSet()
    paths = [opensim.PathActuator.safeDownCast(forces.get(name)) for name in asked["tendons"]]
    out = []
    for posture in asked["postures"]:
        for coordinate, angle in zip(coordinates, posture, strict=True):
            coordinate.setValue(state, angle, False)
        model.realizePosition(state)
        out.append([[path.computeMomentArm(state, each) * _MM for path in paths] for each in coordinates])
    sys.stdout.write(f"\n{json.dumps(out)}\n")


if __name__ == "__main__":
    main()
