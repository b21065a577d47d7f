"""What both writers share: names, numbers, and what a file says of its finger in words."""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.exchange.joint_heads import FLEXION_RANGE, OTHER_RANGE, TendonLine
from fingermodel.exchange.sharing import UNSHARED
from fingermodel.fingers import COMPONENTS, Finger

Floats = NDArray[np.float64]
METRES = 1e-3
LOAD_POINT = "load_point"
# Ours are statics: other software wants some mass all the same.
MASS_KG, INERTIA_KGM2 = 1e-3, 1e-7


@dataclass(frozen=True)
class Written:
    """A file's text.

    Attributes:
        text: XML.
        notes: what the format cannot say of this finger, one line each.
    """

    text: str
    notes: tuple[str, ...]


def segment_names(finger: Finger) -> tuple[str, ...]:
    """Names of the segments, each its own."""
    names: list[str] = []
    for segment in finger.topology.segments:
        same = sum(name == segment.name or name.startswith(f"{segment.name}#") for name in names)
        names.append(f"{segment.name}#{same + 1}" if same else segment.name)
    return tuple(names)


def check_names(finger: Finger) -> None:
    """Refuse a finger whose names the other software cannot hold, or whose bones are no chain.

    Raises:
        ModelError: saying which.
    """
    topology = finger.topology
    for kind, names in (("bone", topology.bones), ("joint", [j.name for j in topology.joints])):
        _refuse_names(kind, names)
    _refuse_names("rotation", topology.rotations)
    _refuse_names("muscle", topology.muscles)
    if any((j.parent, j.child) != (i, i + 1) for i, j in enumerate(topology.joints)):
        raise ModelError(f"the joints of {finger.id} are no chain", "each joint between a bone and the next one")


def _refuse_names(kind: str, names: Sequence[str]) -> None:
    for name in names:
        if not re.fullmatch(r"\w[\w.-]*", name) or name == "ground":
            raise ModelError(f"a {kind} is called {name!r}", "letters, digits, _ . and -", "Rename it")
    twice = {name for name in names if list(names).count(name) > 1}
    if twice:
        raise ModelError(f"two {kind}s are called {sorted(twice)[0]!r}", "a name for each", "Rename one")


def numbers(values: Iterable[float]) -> str:
    """Numbers as XML holds them, every digit of them."""
    return " ".join(number(x) for x in np.asarray(values, dtype=float).tolist())


def number(value: float) -> str:
    """One number, every digit of it."""
    if not math.isfinite(value):
        raise ModelError(f"the finger holds the number {value}", "finite numbers", "Look at what was fitted")
    return repr(float(value) + 0.0)


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """Append an element; one with a trailing underscore in Python (`class_`) loses it."""
    element = ET.SubElement(parent, tag, {k.rstrip("_"): v for k, v in attributes.items()})
    element.text = text
    return element


def xml(root: ET.Element, comment: Sequence[str]) -> str:
    """The file: declaration, comment, elements, indented."""
    ET.indent(root)
    # Two hyphens would end a comment.
    rows = [
        row for line in comment for row in textwrap.wrap(line, 116, subsequent_indent="  ", replace_whitespace=False)
    ]
    words = "\n".join(f"  {re.sub('-(?=-)', '- ', row)}" for row in rows)
    body = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<!--\n{words}\n-->\n{body}\n'


def about(finger: Finger) -> dict[str, Any]:
    """What neither format has an element for, so that a file can be read back."""
    topology, document = finger.topology, finger.document
    body: dict[str, Any] = {
        "format": "finger/1",
        "id": finger.id,
        "title": finger.title,
        "length_unit_mm": finger.length_unit_mm,
        "prior_width": finger.prior_width,
        "muscles": list(topology.muscles),
        "joints": {j.name: list(j.rotations) for j in topology.joints},
        "flexion": {j.name: j.rotations[j.flexion] for j in topology.joints if j.flexion >= 0},
        "reactions": [COMPONENTS[i] for i in topology.reactions],
        "judged_in": finger.judged_in,
    }
    if topology.hood is not None:
        hood = {k: v for k, v in document["hood"].items() if k != "fractions"}
        fractions = {}
        given = zip(topology.fractions, np.asarray(finger.values.fraction), finger.fraction_priors, strict=True)
        for name, value, prior in given:
            prior_of = {"sd": prior.sd, "centre": prior.centre}
            fractions[name] = {"value": float(value), **{k: v for k, v in prior_of.items() if v is not None}}
        body["hood"] = {**hood, "fractions": fractions}
    return body


def about_text(finger: Finger) -> str:
    """The same as one line of JSON."""
    return json.dumps(about(finger), ensure_ascii=False)


def share_table(finger: Finger, names: Sequence[str], shares: Floats | None) -> list[str]:
    """Lines that say which share of each muscle's tension every segment carries; None where shares are not fixed."""
    if shares is None:
        return [f"{UNSHARED}."]
    lines = [f"Shares of the muscles {', '.join(finger.topology.muscles)} in the tension of each segment:"]
    return [*lines, *(f"  {name}: {numbers(row)}" for name, row in zip(names, shares, strict=True))]


def cited(finger: Finger) -> list[str]:
    """Lines that say where the finger's numbers come from."""
    return [f"Source {name}: {text}" for name, text in finger.document.get("sources", {}).items()]


def upwards(value: float) -> str:
    """Two digits of a positive number, rounded up."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / step) * step:.2g}"


def inexact(finger: Finger, names: Sequence[str], lines: Sequence[TendonLine], format_name: str) -> str:
    """One line on the segments whose moment arms a format's path does not have, empty where there are none."""
    wrong = [(name, line) for name, line in zip(names, lines, strict=True) if not line.exact]
    if not wrong:
        return ""
    worst: dict[str, float] = {}
    for _, line in wrong:
        for rotation, fault in line.fault.items():
            worst[rotation] = max(worst.get(rotation, 0.0), fault)
    low, high = (round(math.degrees(x)) for x in FLEXION_RANGE)
    of = ", ".join(f"{upwards(fault)} mm about {rotation}" for rotation, fault in worst.items()) or "nothing"
    others = " and other angles within " + f"±{math.degrees(OTHER_RANGE[1]):.0f}°"
    return (
        f"{format_name} cannot hold the resting line of {', '.join(name for name, _ in wrong)} as Landsmeer's first "
        f"model does: they run over cylinders or straight instead, and where they rest their moment arms differ from "
        f"ours by up to {of} (flexion {low}° to {high}°{others if len(worst) > 1 else ''})"
    )
