"""A finger: bones, joints, rotation axes, tendon points and the sharing of the extensor hood.

What never changes while computing (names, who is joined to whom, which rule of wrapping) is a `Topology`, hashable
and static for the compiler. What is a number (centres, axes, points, fractions) is a `FingerValues`, a tuple of arrays
that the model differentiates. Units are millimetres and newtons throughout.

Frames: every bone has x proximal, y dorsal, z radial (right-handed on a right hand). A phalanx's origin is the centre
of the joint at its base, the metacarpal's is the centre of the MCP joint. Flexion is a positive rotation of the distal
bone about +z; abduction is a rotation about +y.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.errors import InputError
from daq.vocabulary import did_you_mean
from fingermodel.hood.parts import ElasticHood

if TYPE_CHECKING:
    import jax

# Both kinds pass through the model: NumPy's when a finger is read, JAX's while it is differentiated.
Array: TypeAlias = "NDArray[np.float64] | jax.Array"

COMPONENTS = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
Plane = Literal["sagittal", "space"]
# How many force components, from Fx on, lie in it.
PLANES = {"sagittal": 2, "space": 3}
WRAPS = ("straight", "landsmeer1_dorsal", "landsmeer1_palmar")


def require_plane(name: str) -> Plane:
    """Return the plane of a name.

    Raises:
        InputError: there is none of that name.
    """
    if name not in PLANES:
        raise InputError(f"plane {name!r:.60}", " or ".join(PLANES), did_you_mean(name, PLANES))
    return cast(Plane, name)


@dataclass(frozen=True)
class Joint:
    """A joint between two bones, with its rotations from proximal to distal, each carried by the one before.

    `flexion` is the index within `rotations` of the rotation about which tendons wrap (-1: none).
    """

    name: str
    parent: int
    child: int
    rotations: tuple[str, ...]
    flexion: int


@dataclass(frozen=True)
class Segment:
    """A piece of tendon from a point on one bone to a point on a more distal one.

    `slip` is the name of the tendon or slip of the hood (FDP, TE, RB, …). `source` is the muscle that pulls it with its
    whole tension, or the hood's slip that does. `wrap` is one of `WRAPS`: Landsmeer's first model keeps the line of
    action of 0° relative to the distal bone once the joint bends towards the other side. `rests_at` [rad] is the
    flexion at which the line comes to rest, where that is not 0: so a tendon on a cylinder about the axis does.
    """

    slip: str
    joint: str
    proximal_bone: int
    distal_bone: int
    wrap: str
    rests_at: float = 0.0

    @property
    def name(self) -> str:
        """Name of the segment, such as `PIP.FDS`."""
        return f"{self.joint}.{self.slip}"


@dataclass(frozen=True)
class Hood:
    """Winslow's rhombus: which muscles enter it on which side, and which slips leave it.

    A fraction `<muscle>_ES` of what a muscle sends into the hood goes to the central slip; the rest to the band of its
    side; the extensor's rest to both bands in halves. `<muscle>_EM` is the fraction of a muscle that enters the hood at
    all (the rest inserts at the proximal phalanx). Source: Synek et al. 2019, after Zancolli 1979.
    """

    radial: tuple[str, ...]
    ulnar: tuple[str, ...]
    extensors: tuple[str, ...]
    partial: tuple[str, ...]
    central_slip: str
    radial_band: str
    ulnar_band: str
    terminal_slip: str

    @property
    def members(self) -> tuple[str, ...]:
        """Every muscle that enters the hood."""
        return (*self.radial, *self.ulnar, *self.extensors)

    @property
    def fractions(self) -> tuple[str, ...]:
        """Names of the fractions, in the order of `FingerValues.fractions`."""
        return (*(f"{m}_ES" for m in self.members), *(f"{m}_EM" for m in self.partial))


@dataclass(frozen=True)
class Topology:
    """What is joined to what. Hashable: the compiler keys on it."""

    bones: tuple[str, ...]
    joints: tuple[Joint, ...]
    segments: tuple[Segment, ...]
    muscles: tuple[str, ...]
    hood: Hood | ElasticHood | None
    reactions: tuple[int, ...]

    @property
    def rotations(self) -> tuple[str, ...]:
        """Names of the degrees of freedom, proximal to distal."""
        return tuple(name for joint in self.joints for name in joint.rotations)

    @property
    def fractions(self) -> tuple[str, ...]:
        """Names of the hood's fractions."""
        return self.hood.fractions if self.hood else ()

    def joint(self, name: str) -> Joint:
        """Return the joint of that name."""
        return next(j for j in self.joints if j.name == name)


class FingerValues(NamedTuple):
    """The numbers of a finger, all in mm and in the frame of the bone that carries them.

    Attributes:
        centre: (joints, 3) joint centre in the parent bone.
        axis: (rotations, 3) unit vector in the parent's axes at the zero posture.
        proximal_point: (segments, 3) in the segment's proximal bone.
        distal_point: (segments, 3) in the segment's distal bone.
        fraction: (fractions,) shares of the hood, or the parameters of an elastic one.
        load_point: (3,) where the clamp holds the most distal bone.
        suture: (muscles, 3) unit vector along which each tendon leaves the first bone.
    """

    centre: Array
    axis: Array
    proximal_point: Array
    distal_point: Array
    fraction: Array
    load_point: Array
    suture: Array


@dataclass(frozen=True)
class FractionPrior:
    """What is known of a hood fraction before fitting.

    `sd` None takes the budget's, 0 keeps the fraction fixed; `centre` is the prior's where it is not the model's value.
    """

    sd: float | None
    centre: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Finger:
    """A named finger with its numbers and where they come from.

    `length_unit_mm` is the length in which An et al. 1979 normalise (O2O3), kept because the published penalty (Eq 5)
    acts on normalised coordinates. `prior_width` multiplies the budget's tendon-point uncertainty. `judged_in` is
    `sagittal` where the finger's axes cannot predict the out-of-plane force, so that a fit leaves it out. `document` is
    the file that the numbers came from, with the source and certainty of each.
    """

    id: str
    title: str
    topology: Topology
    values: FingerValues
    length_unit_mm: float
    prior_width: float
    fraction_priors: tuple[FractionPrior, ...]
    judged_in: Plane = "space"
    document: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"<Finger {self.id}: {self.title}>"

    def replace_values(self, **changes: ArrayLike) -> Finger:
        """Return a copy with some arrays of `values` replaced."""
        arrays = {k: np.asarray(v, dtype=float) for k, v in changes.items()}
        return replace(self, values=self.values._replace(**arrays))

    def is_built_as(self, other: Finger) -> bool:
        """Whether both have the same parts and bones, whatever a fit made of tendon points and fractions."""
        ours, theirs = (
            np.concatenate([np.ravel(part) for part in (v.centre, v.axis, v.load_point, v.suture)])
            for v in (self.values, other.values)
        )
        return (self.id, self.topology) == (other.id, other.topology) and bool(np.allclose(ours, theirs))

    def phalanx_lengths_mm(self) -> dict[str, float]:
        """Length of each phalanx from its joint centre to the next one, or for the last one as far as is known."""
        topology, out = self.topology, {}
        for joint in topology.joints[1:]:
            out[topology.bones[joint.parent]] = float(np.linalg.norm(self.values.centre[topology.joints.index(joint)]))
        return out
