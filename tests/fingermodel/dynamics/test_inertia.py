"""Inertia of segments: the cylinder's formula, superposition, and what a file may say."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from daq.errors import ModelError
from fingermodel.dynamics.inertia import EllipticCylinder, SegmentShape, chain_inertia, read_segments
from fingermodel.fingers.files import finger_from_dict, read_finger

sizes = st.floats(0.5, 40.0)


@given(width=sizes, depth=sizes, length=sizes)
def test_a_cylinder_has_the_moments_of_its_mass(width: float, depth: float, length: float) -> None:
    """Against quadrature: Gauss over the length, the exact rule of second moments on rings over the ellipse."""
    found = EllipticCylinder(width, depth, length).inertia(1200.0)
    x, w = np.polynomial.legendre.leggauss(8)
    radius = np.sqrt(0.5 * (x + 1.0))
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    along, r, a = np.meshgrid(0.5 * length * x, radius, angle, indexing="ij")
    share = w[:, None, None] / 2 * w[None, :, None] / 2 / len(angle) * np.ones_like(a)
    mass = 1200e-9 * np.pi * width * depth * length * share
    place = np.stack([along, depth * r * np.cos(a), width * r * np.sin(a)])
    square = place**2
    moments = [(mass * (square.sum(axis=0) - square[i])).sum() for i in range(3)]
    assert_allclose(found.mass_kg, mass.sum(), rtol=1e-12)
    assert_allclose(found.moments_kg_mm2, moments, rtol=1e-9)


@pytest.mark.parametrize("shape", read_segments("wu2008"), ids=lambda s: s.bone)
def test_superposition(shape: SegmentShape) -> None:
    """A bone as dense as its tissue, filled again, is no bone at all."""
    filled = replace(shape, bone_density=shape.tissue_density, canal=EllipticCylinder(1e-9, 1e-9, 1e-9))
    whole = shape.tissue.inertia(shape.tissue_density)
    assert_allclose(filled.inertia().moments_kg_mm2, whole.moments_kg_mm2, rtol=1e-12)
    assert_allclose(filled.inertia().mass_kg, whole.mass_kg, rtol=1e-12)
    moments = shape.inertia().moments_kg_mm2
    assert (moments.sum() - 2.0 * moments > 0.0).all()  # as of any body


def test_a_fingers_inertia_is_read_in_the_models_units() -> None:
    inertia = chain_inertia(read_finger("wu2008_index"))
    assert_allclose(inertia.mass, [1.55e-5, 6.79e-6, 3.91e-6])
    assert_allclose(inertia.moments[2], [1.04e-4, 1.9e-4, 1.7e-4])
    assert (inertia.centre[:, 0] < 0.0).all()


def test_a_finger_without_inertia_says_so() -> None:
    with pytest.raises(ModelError, match=r"an1979_middle has no inertia of PP, MP, DP"):
        chain_inertia(read_finger("an1979_middle"))
    assert "inertia" not in read_finger("an1979_middle").document


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"bone": "MC"}, "inertia of 'MC', 1 times; expected one of PP, MP, DP"),
        ({"bone": "MP"}, "inertia of 'MP', 2 times"),
        ({"mass_kg": -1.0}, "mass_kg: must be greater than 0"),
        ({"principal_kg_mm2": [1.0, 0.0, 1.0]}, "principal_kg_mm2.1: must be greater than 0"),
        ({"source": "nobody"}, "source 'nobody' is not listed"),
    ],
    ids=["fixed bone", "twice", "negative mass", "no moment", "source"],
)
def test_a_bad_inertia_block_is_named(change: dict[str, Any], said: str) -> None:
    document = copy.deepcopy(read_finger("wu2008_index").document)
    document["inertia"][0] |= change
    with pytest.raises(ModelError) as caught:
        finger_from_dict(document, "mine.yaml")
    assert said in str(caught.value)


def test_unknown_segments_are_named() -> None:
    with pytest.raises(ModelError, match="no segments 'x'; expected a file, or one of wu2008"):
        read_segments("x")
