"""How sure an inverse analysis is: what errors of the reading, the posture and the tendon points do to its forces.

The closures whose laws are linear are propagated by their derivatives. `least_squares` has bounds, at which a
derivative says little, so it is computed again for draws from the priors; so may the others be, to check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import Finger
from fingermodel.inverse.areas import areas_of
from fingermodel.inverse.closures import Closure, slip_names
from fingermodel.inverse.equilibrium import Balance, Cases, balance_slopes, balances, demands, loads_of
from fingermodel.inverse.least_stress import least_stress
from fingermodel.model import jax_values

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Given:
    """What an inverse analysis takes as given, and how well it is known.

    Attributes:
        anatomy: (anatomy parameters,) tendon points [mm] and fractions, as `model.with_anatomy` reads them.
        anatomy_sd: (anatomy parameters,).
        anatomy_lower: (anatomy parameters,) bound of the draws.
        anatomy_upper: (anatomy parameters,) bound of the draws.
        posture: (n, rotations) [rad].
        posture_sd: (rotations,) [rad].
        wrench: (n, 6) of the finger on the tip clamp [N, N mm], most distal bone's axes.
        wrench_covariance: (n, 6, 6).
        unread: (n, 6) components that may take any value; only `least_squares` allows for them.
    """

    anatomy: Floats
    anatomy_sd: Floats
    anatomy_lower: Floats
    anatomy_upper: Floats
    posture: Floats
    posture_sd: Floats
    wrench: Floats
    wrench_covariance: Floats
    unread: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Inverse:
    """What a closure assigns to each wrench, with standard deviations.

    Attributes:
        muscle: (n, muscles of the closure) [N].
        muscle_sd: the same shape.
        slip: (n, slips) [N], in the order of `slip_names`.
        slip_sd: the same shape.
        contact: (n, joints, 3) force of each child bone on its parent [N], parent's axes.
        contact_sd: the same shape.
        contact_norm_sd: (n, joints) of its magnitude [N].
        unbalanced: (n, rotations) torque that tensions that pull cannot make [N mm]; zero for the linear closures.
    """

    muscle: Floats
    muscle_sd: Floats
    slip: Floats
    slip_sd: Floats
    contact: Floats
    contact_sd: Floats
    contact_norm_sd: Floats
    unbalanced: Floats


def invert(finger: Finger, closure: Closure, given: Given, draws: int = 100, seed: int = 0) -> Inverse:
    """Assign tensions and contact forces to wrenches.

    Args:
        finger: whose axes, centres and hood hold; its points and fractions are those of `given`.
        closure: of this finger.
        given: posture and wrench of every case.
        draws: from the priors, for `least_squares`.
        seed: of the draws.
    """
    if closure.name == "least_squares":
        return _drawn(finger, closure, given, draws, seed)
    return _linear(finger, closure, given)


def sampled(finger: Finger, closure: Closure, given: Given, draws: int, seed: int = 0) -> tuple[Floats, Balance]:
    """Muscles (draws, n, muscles), slips and contact forces of draws from the priors, in that order of axes."""
    n = len(given.wrench)
    muscle, balance, _ = _assigned(finger, closure, _draw(given, draws, seed), np.tile(given.unread, (draws, 1)))
    slip, contact = np.asarray(balance.slip), np.asarray(balance.contact)
    return (
        muscle.reshape(draws, n, -1),
        Balance(slip.reshape(draws, n, -1), contact.reshape(draws, n, *contact.shape[1:])),  # type: ignore[arg-type]
    )


def _linear(finger: Finger, closure: Closure, given: Given) -> Inverse:
    topology = finger.topology
    n = len(given.wrench)
    muscle, balance, unbalanced = _assigned(finger, closure, _repeated(given), given.unread)
    slopes = balance_slopes(topology, closure.matrix(topology), jax_values(finger.values), _repeated(given))
    slip, contact = np.asarray(balance.slip), np.asarray(balance.contact)
    both = np.concatenate([np.asarray(slopes.slip), np.asarray(slopes.contact).reshape(n, contact[0].size, -1)], axis=1)
    a, r = len(given.anatomy_sd), len(given.posture_sd)
    own = np.concatenate([given.anatomy_sd, given.posture_sd])
    fixed = both[:, :, : a + r] * own
    read = both[:, :, a + r :]
    covariance = fixed @ fixed.swapaxes(1, 2) + read @ given.wrench_covariance @ read.swapaxes(1, 2)
    sd = np.sqrt(np.einsum("nii->ni", covariance))
    k = slip.shape[1]
    chosen = _muscle_slips(finger, closure)
    return Inverse(
        muscle,
        sd[:, chosen],
        slip,
        sd[:, :k],
        contact,
        sd[:, k:].reshape(contact.shape),
        _norm_sd(contact, covariance[:, k:, k:]),
        unbalanced,
    )


def _norm_sd(contact: Floats, covariance: Floats) -> Floats:
    """Of the magnitude of each contact force, to first order."""
    n, joints, _ = contact.shape
    size = np.linalg.norm(contact, axis=2, keepdims=True)
    along = contact / np.where(size > 0.0, size, 1.0)
    blocks = covariance.reshape(n, joints, 3, joints, 3)
    own = np.einsum("njajb->njab", blocks)
    return np.sqrt(np.einsum("nja,njab,njb->nj", along, own, along))


def _drawn(finger: Finger, closure: Closure, given: Given, draws: int, seed: int) -> Inverse:
    muscle, balance, unbalanced = _assigned(finger, closure, _repeated(given), given.unread)
    muscles, drawn = sampled(finger, closure, given, draws, seed)
    slip, contact = np.asarray(balance.slip), np.asarray(balance.contact)
    slips, contacts = np.asarray(drawn.slip), np.asarray(drawn.contact)
    return Inverse(
        muscle,
        _reach(muscles, muscle),
        slip,
        _reach(slips, slip),
        contact,
        _reach(contacts, contact),
        _reach(np.linalg.norm(contacts, axis=3), np.linalg.norm(contact, axis=2)),
        unbalanced,
    )


def _reach(draws: Floats, assigned: Floats) -> Floats:
    """How far from what is assigned 68 % of the draws lie at most; of normal draws about it the standard deviation.

    A few draws with much co-contraction would swamp a variance. An answer that is itself such a rare one gets a wide
    bar, since most draws are far from it.
    """
    reach: Floats = np.quantile(np.abs(draws - assigned), 0.6827, axis=0)
    return reach


def _assigned(
    finger: Finger, closure: Closure, cases: Cases, unread: NDArray[np.bool_]
) -> tuple[Floats, Balance, Floats]:
    """Muscles (n, muscles), the balance and the unbalanced torque (n, rotations)."""
    topology, values = finger.topology, jax_values(finger.values)
    if closure.name != "least_squares":
        balance = balances(topology, closure.matrix(topology), values, cases)
        muscle = np.asarray(balance.slip)[:, _muscle_slips(finger, closure)]
        return muscle, balance, np.zeros(cases.posture.shape)
    demand = demands(topology, values, cases)
    area = areas_of(finger).cm2
    each = zip(demand.arms, demand.torque, demand.tip, unread, strict=True)
    held = [least_stress(arms, torque, area, tip[free]) for arms, torque, tip, free in each]
    tension = np.array([h.tension for h in held])
    return tension, loads_of(topology, values, cases, tension), np.array([h.unbalanced for h in held])


def _muscle_slips(finger: Finger, closure: Closure) -> list[int]:
    names = slip_names(finger.topology)
    return [names.index(m.slip) for m in closure.muscles]


def _repeated(given: Given) -> Cases:
    return Cases(np.tile(given.anatomy, (len(given.wrench), 1)), given.posture, given.wrench)


def _draw(given: Given, draws: int, seed: int) -> Cases:
    """Every draw of every case, draws slowest; one draw has the same anatomy in all cases."""
    rng = np.random.default_rng(seed)
    n = len(given.wrench)
    anatomy = given.anatomy + given.anatomy_sd * rng.standard_normal((draws, 1, len(given.anatomy)))
    # A fraction drawn beyond its range would be no share of anything.
    anatomy = np.clip(anatomy, given.anatomy_lower, given.anatomy_upper)
    posture = given.posture + given.posture_sd * rng.standard_normal((draws, n, given.posture.shape[1]))
    values, vectors = np.linalg.eigh(given.wrench_covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    wrench = given.wrench + np.einsum("nij,dnj->dni", root, rng.standard_normal((draws, n, 6)))
    return Cases(
        np.broadcast_to(anatomy, (draws, n, len(given.anatomy))).reshape(draws * n, -1),
        posture.reshape(draws * n, -1),
        wrench.reshape(draws * n, 6),
    )
