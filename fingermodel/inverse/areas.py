"""Physiological cross-sectional areas of a finger's muscles: `data/areas/pcsa.yaml`, format `areas/1`."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from daq.documents import Document, read_document, validated
from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.fingers import Finger

Floats = NDArray[np.float64]
WANTED = "an areas/1 file"


class _Set(Document):
    id: str
    fingers: list[str]
    areas_cm2: dict[str, float] = Field(min_length=1)
    source: str
    certainty: Literal["high", "medium", "low", "assumed", "fitted"]
    note: str = ""


class _AreasFile(Document):
    format: Literal["areas/1"]
    sets: list[_Set] = Field(min_length=1)


class Areas(NamedTuple):
    """Areas of a finger's muscles.

    Attributes:
        cm2: (muscles,).
        source: where they come from, and for which digit where that is another.
    """

    cm2: Floats
    source: str


def areas_of(finger: Finger) -> Areas:
    """Areas of a finger's muscles: of its own digit where they are known, else of the third.

    Raises:
        ModelError: a muscle of which no area is known.
    """
    path = data_dir() / "areas" / "pcsa.yaml"
    sets = validated(_AreasFile, read_document(path, WANTED, ModelError), path.name, WANTED, ModelError).sets
    own = next((s for s in sets if finger.id in s.fingers), None)
    chosen = own or sets[0]
    missing = [m for m in finger.topology.muscles if not chosen.areas_cm2.get(m, 0.0) > 0.0]
    if missing:
        raise ModelError(
            f"no cross-sectional area for {missing[0]} of {finger.id}", f"muscles of {', '.join(chosen.areas_cm2)}"
        )
    areas = np.array([chosen.areas_cm2[m] for m in finger.topology.muscles])
    return Areas(areas, chosen.source if own else f"{chosen.source}; assumed for {finger.id}")
