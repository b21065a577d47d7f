"""Hill-type muscles: curves of the contractile, the parallel and the series element, and isometric equilibrium.

Lengths are in optimal fibre lengths, speeds in the greatest shortening speed (lengthening positive), forces in the
greatest isometric force. A set of curves is a hashable value, static for the compiler; a muscle's numbers are arrays.

`Thelen2003` has the forms and numbers of Thelen 2003 (J Biomech Eng 125:70–77). `AnyMuscle3E` has those of the
three-element model that Wu et al. 2008 used: tendon and parallel element exponential with shape parameters (after Zajac
1989), Hill's hyperbola and a parabola for the active force as in van den Bogert et al. 1998.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

jax.config.update("jax_enable_x64", True)

Floats = NDArray[np.float64]
STEPS = 60


class Curves(Protocol):
    """What a set of curves gives."""

    @property
    def tendon_strain(self) -> float:
        """Strain of the tendon at the greatest isometric force."""

    def active_length(self, length: Array) -> Array:
        """Active isometric force over fibre length; 1 at 1."""

    def velocity(self, speed: Array) -> Array:
        """Active force over speed; 1 at 0, 0 at -1."""

    def passive(self, length: Array) -> Array:
        """Force of the parallel element over fibre length; 0 up to 1."""

    def tendon(self, strain: Array) -> Array:
        """Force of the tendon over its strain; 0 up to 0, 1 at `tendon_strain`."""


def _hill(speed: Array, curvature: float, most: float) -> Array:
    """Hill's hyperbola in shortening, continued in lengthening with the same slope up to a plateau."""
    slope = 1.0 + 1.0 / curvature
    c = (most - 1.0) / slope
    shortening = jnp.clip(speed, -1.0, 0.0)
    lengthening = jnp.maximum(speed, 0.0)
    return jnp.where(
        speed < 0.0,
        (1.0 + shortening) / (1.0 - shortening / curvature),
        (most * lengthening + c) / (lengthening + c),
    )


def _exponential(excess: Array, shape: float, at_one: float) -> Array:
    """0 up to no excess, 1 where it is `at_one`."""
    return jnp.expm1(shape * jnp.maximum(excess, 0.0) / at_one) / jnp.expm1(shape)


@dataclass(frozen=True)
class Thelen2003:
    """Curves of Thelen 2003, numbers of his young adults.

    Attributes:
        tendon_strain: at the greatest isometric force; 0.04 there, 0.033 in Barry et al. 2018.
        width: of the Gaussian of active force over length.
        passive_shape: of the parallel element.
        passive_strain: of the fibre where the parallel element carries the greatest isometric force.
        curvature: of the force–velocity curve at full activation.
        most: plateau in lengthening.
    """

    tendon_strain: float = 0.04
    width: float = 0.45
    passive_shape: float = 5.0
    passive_strain: float = 0.6
    curvature: float = 0.25
    most: float = 1.4

    def active_length(self, length: Array) -> Array:
        """Gaussian."""
        return jnp.exp(-((length - 1.0) ** 2) / self.width)

    def velocity(self, speed: Array) -> Array:
        """Eqs 6 and 7 of the paper at full activation, solved for the force."""
        shortening = jnp.clip(speed, -1.0, 0.0)
        lengthening = jnp.maximum(speed, 0.0)
        b = (2.0 + 2.0 / self.curvature) * lengthening
        rest = self.most - 1.0
        return jnp.where(
            speed < 0.0,
            (1.0 + shortening) / (1.0 - shortening / self.curvature),
            (rest + b * self.most) / (rest + b),
        )

    def passive(self, length: Array) -> Array:
        """Exponential."""
        return _exponential(length - 1.0, self.passive_shape, self.passive_strain)

    def tendon(self, strain: Array) -> Array:
        """Exponential toe up to a third of the force, then a line."""
        toe, at_toe, shape = 0.609 * self.tendon_strain, 0.33, 3.0
        slope = 1.712 / self.tendon_strain
        curved = at_toe * jnp.expm1(shape * jnp.clip(strain, 0.0, toe) / toe) / jnp.expm1(shape)
        return jnp.where(strain <= toe, curved, slope * (strain - toe) + at_toe)


@dataclass(frozen=True)
class AnyMuscle3E:
    """Curves of the three-element model of Wu et al. 2008.

    Attributes:
        tendon_strain: Epsilon0.
        tendon_shape: Jt.
        passive_shape: Jpe.
        passive_length: PEFactor, the fibre length at which the parallel element carries the greatest isometric force.
        width: half the range of lengths over which the fibre is active (assumed, after van den Bogert et al. 1998; it
            does not enter forces found by recruitment).
        curvature: of Hill's hyperbola (assumed, the usual 0.25).
        most: plateau in lengthening (assumed, the usual 1.5).
    """

    tendon_strain: float = 0.05
    tendon_shape: float = 3.0
    passive_shape: float = 3.0
    passive_length: float = 5.0
    width: float = 0.56
    curvature: float = 0.25
    most: float = 1.5

    def active_length(self, length: Array) -> Array:
        """Parabola, zero beyond its width."""
        return jnp.maximum(1.0 - ((length - 1.0) / self.width) ** 2, 0.0)

    def velocity(self, speed: Array) -> Array:
        """Hill's hyperbola."""
        return _hill(speed, self.curvature, self.most)

    def passive(self, length: Array) -> Array:
        """Exponential."""
        return _exponential(length - 1.0, self.passive_shape, self.passive_length - 1.0)

    def tendon(self, strain: Array) -> Array:
        """Exponential."""
        return _exponential(strain, self.tendon_shape, self.tendon_strain)


CURVES: dict[str, type[Thelen2003] | type[AnyMuscle3E]] = {"thelen2003": Thelen2003, "wu2008": AnyMuscle3E}


class HillValues(NamedTuple):
    """Numbers of one muscle, or of several with a leading axis.

    Attributes:
        max_force: greatest isometric force [N].
        fibre: optimal length [mm].
        pennation: at that length [rad].
        slack: length of the tendon at which it begins to pull [mm].
        passive_share: part of the fibres that has a parallel element, mostly 1.
    """

    max_force: Array | Floats
    fibre: Array | Floats
    pennation: Array | Floats
    slack: Array | Floats
    passive_share: Array | Floats | float = 1.0


class HillState(NamedTuple):
    """A muscle at rest under some activation.

    Attributes:
        tension: of the tendon [N].
        active: part of it from the contractile element [N].
        passive: part of it from the parallel element [N].
        length: of the fibre, in optimal lengths.
    """

    tension: Array
    active: Array
    passive: Array
    length: Array


def max_speed(fibre_mm: Floats, fast_fraction: Floats, slow: float = 2.0, fast: float = 8.0) -> Floats:
    """Greatest shortening speed [mm/s]: `slow` optimal lengths a second, and `fast` more if all fibres were fast."""
    return fibre_mm * (slow + fast * fast_fraction)


def slack_length(curves: Curves, along_mm: Floats, length_mm: Floats) -> Floats:
    """Slack length at which the fibre has its optimal length under the full isometric force [mm].

    Args:
        curves: of the muscle.
        along_mm: extent of the fibre along the tendon at its optimal length.
        length_mm: of muscle and tendon together.
    """
    return (length_mm - along_mm) / (1.0 + curves.tendon_strain)


def isometric(curves: Curves, muscle: HillValues, length_mm: Array, activation: Array) -> HillState:
    """Fibre and tendon in equilibrium at rest, for one muscle.

    The fibre keeps its thickness, so its pennation follows from its length. Differentiable in everything: the
    equilibrium is found by halving, and its derivative is that of the implicit function. Where the whole is shorter
    than the tendon alone, nothing pulls.

    Args:
        curves: of the muscle (static).
        muscle: its numbers.
        length_mm: of muscle and tendon together.
        activation: 0 to 1.
    """
    muscle = HillValues(*(jnp.asarray(v, dtype=float) for v in muscle))
    length, level = jnp.asarray(length_mm, dtype=float), jnp.asarray(activation, dtype=float)
    least = 1e-3 * muscle.fibre

    def unbalanced(along: Array, given: tuple[HillValues, Array, Array]) -> Array:
        """What the fibre pulls beyond the tendon, for the fibre's extent along the tendon [mm]."""
        m, whole, a = given
        active, passive, _ = _fibre(curves, m, along, a)
        return active + passive - m.max_force * curves.tendon((whole - along) / m.slack - 1.0)

    given = (muscle, length, level)
    held = jax.tree.map(jax.lax.stop_gradient, given)

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        too_long = unbalanced(middle, held) > 0.0
        return jnp.where(too_long, low, middle), jnp.where(too_long, middle, high)

    # With the tendon just slack the fibre cannot pull less than it.
    longest = jnp.maximum(held[1] - held[0].slack, jax.lax.stop_gradient(least))
    low, high = jax.lax.fori_loop(0, STEPS, halve, (jax.lax.stop_gradient(least), longest))
    root = 0.5 * (low + high)
    slope = jax.grad(unbalanced)(root, held)
    # One step of Newton: exact where the root is, and it carries the derivatives.
    along = root - jnp.where(slope > 0.0, unbalanced(root, given) / jnp.where(slope > 0.0, slope, 1.0), 0.0)
    active, passive, fibre = _fibre(curves, muscle, along, level)
    taut = length - muscle.slack > least
    active, passive = jnp.where(taut, active, 0.0), jnp.where(taut, passive, 0.0)
    return HillState(active + passive, active, passive, fibre)


def _fibre(curves: Curves, muscle: HillValues, along: Array, activation: Array) -> tuple[Array, Array, Array]:
    """Active and passive pull along the tendon [N], and length of the fibre, from its extent along the tendon [mm]."""
    across = muscle.fibre * jnp.sin(muscle.pennation)
    fibre = jnp.sqrt(along**2 + across**2)
    cosine = along / fibre
    length = fibre / jnp.asarray(muscle.fibre)
    scale = jnp.asarray(muscle.max_force) * cosine
    active = scale * activation * curves.active_length(length)
    return active, scale * muscle.passive_share * curves.passive(length), length


@partial(jax.jit, static_argnums=0)
def at_rest(
    curves: Curves, muscles: HillValues, max_speed: Array | Floats, length_mm: Array | Floats, rate: Array | Floats
) -> tuple[Array, Array]:
    """Passive tension of moving muscles, and what full activation would add [N]: (n, muscles) each.

    The tendon's stretch by the active force is left out of the fibre's length and speed.

    Args:
        curves: of all muscles (static).
        muscles: their numbers, (muscles,) each.
        max_speed: (muscles,) greatest shortening speed of the fibres [mm/s].
        length_mm: (n, muscles) of muscle and tendon together.
        rate: (n, muscles) its rate [mm/s].
    """

    def one(muscle: HillValues, speed: Array, whole: Array, change: Array) -> tuple[Array, Array]:
        state = isometric(curves, muscle, whole, jnp.zeros(()))
        sine = jnp.sin(muscle.pennation) / jnp.maximum(state.length, 1e-3)
        cosine = jnp.sqrt(jnp.maximum(1.0 - sine**2, 0.0))
        factor = curves.active_length(state.length) * curves.velocity(change * cosine / speed)
        return state.tension, jnp.asarray(muscle.max_force) * cosine * factor

    over_muscles = jax.vmap(one, in_axes=(0, 0, 0, 0))
    return jax.vmap(over_muscles, in_axes=(None, None, 0, 0))(
        muscles, jnp.asarray(max_speed), jnp.asarray(length_mm), jnp.asarray(rate)
    )
