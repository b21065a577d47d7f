"""The small instrument and posture errors that every rig has: always free in a fit, never a discovery.

Priors come from a named budget (certificates of a calibrated cell; the scatter of the published study, or of the
session's own forces) or from the session. Each error is an effect like any other, acting at its stage.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, final

import jax.numpy as jnp
import numpy as np
from jax import Array

from daq.errors import ModelError
from daq.vocabulary import did_you_mean
from fingermodel.fingers import Finger, Topology
from fingermodel.kinematics import turn_about
from fingermodel.parameters import Parameter
from fingermodel.rows import chosen
from fingermodel.stages import Effect, Layout, LoadCaseInput, State
from fingermodel.vectors import cross


@dataclass(frozen=True)
class Budget:
    """One-sigma sizes of the errors that every rig has.

    Attributes:
        name: of the budget.
        tension_factor_sd: friction of each tendon's pulley about the session's factor, relative.
        tension_factor_common_sd: error of that factor, common to the session, relative.
        tension_factor_case_sd: scatter of it from case to case, relative.
        cell_rotation_sd_deg: the cell's axes against the mount's, about each axis, per mounting.
        cell_gain_sd: gain of each axis of the cell, relative.
        zero_tip_sd_N: unloaded reading that the tare missed, each axis, at the tip.
        zero_bone_sd_N: the same at the bone.
        angle_sd_deg: each joint angle, per setting.
        tendon_point_sd_mm: x and y of the tendon points by joint; z has half of it.
        fraction_sd: fractions of the hood.
        mount_offset_sd_mm: where the cell's origin lies, seen from the load point, each mount axis, per mounting.
        reading_sd_N: scatter of an averaged force component that states no uncertainty of its own.
    """

    name: str = "certificate"
    tension_factor_sd: float = 0.012
    tension_factor_common_sd: float = 0.0
    tension_factor_case_sd: float = 0.0
    cell_rotation_sd_deg: float = 0.6
    cell_gain_sd: float = 0.004
    zero_tip_sd_N: float = 0.015
    zero_bone_sd_N: float = 0.02
    angle_sd_deg: float = 1.0
    tendon_point_sd_mm: tuple[tuple[str, float], ...] = (("DIP", 0.6), ("PIP", 0.6), ("MCP", 1.8))
    fraction_sd: float = 0.15
    mount_offset_sd_mm: float = 2.0
    reading_sd_N: float = 0.08

    def with_tension_sd(self, *shares: float) -> Budget:
        """The same where further relative errors, each by its standard uncertainty, are common to all tensions."""
        common = float(np.linalg.norm([self.tension_factor_common_sd, *shares]))
        return replace(self, tension_factor_common_sd=common) if any(shares) else self

    def as_dict(self) -> dict[str, Any]:
        """Return it as `budget_of` reads it."""
        return asdict(self) | {"tendon_point_sd_mm": dict(self.tendon_point_sd_mm)}


CERTIFICATE = Budget()
# The scatter of c within H02, H03 and B01, superposition to 0.1–0.2 N, and sqrt(0.11² / w) for the points of Eq 5.
# Averaged forces came from a calibrated cell too, so its rotation and zero stay those of the certificate; the session
# says nothing of where on the pulp the cell's origin lay, but no moments were published either.
SYNEK2019 = Budget(
    name="synek2019",
    tension_factor_sd=0.0,
    tension_factor_common_sd=0.06,
    tension_factor_case_sd=0.025,
    angle_sd_deg=3.0,
    tendon_point_sd_mm=(("DIP", 0.8), ("PIP", 0.8), ("MCP", 2.6)),
    reading_sd_N=0.08,
)
# The certificate's, but for the scatter from case to case, which the session's own forces tell.
ESTIMATE = replace(CERTIFICATE, name="estimate")
BUDGETS = {b.name: b for b in (CERTIFICATE, SYNEK2019, ESTIMATE)}


def budget_of(setting: str | Mapping[str, Any] | None, case_sd: float = 0.0) -> Budget:
    """Return a session's budget: named, spelled out, or by default `certificate`.

    Args:
        setting: the session's `budget`.
        case_sd: scatter of tensions from case to case by its own forces, of which `estimate` makes use.

    Raises:
        ModelError: a name or key that does not exist, or a negative size.
    """
    if setting is None:
        return CERTIFICATE
    if isinstance(setting, str):
        if setting not in BUDGETS:
            raise ModelError(f"budget {setting!r} is not known", f"one of {', '.join(BUDGETS)}, or its values")
        named = BUDGETS[setting]
        return replace(named, tension_factor_case_sd=case_sd) if named is ESTIMATE else named
    known = {f.name for f in fields(Budget)} - {"name"}
    values: dict[str, Any] = {}
    base = budget_of(str(setting.get("base", "certificate")), case_sd)
    for key, value in setting.items():
        if key == "base":
            continue
        if key not in known:
            raise ModelError(f"budget has no {key!r}", f"some of {', '.join(sorted(known))}", did_you_mean(key, known))
        if key == "tendon_point_sd_mm":
            if not isinstance(value, Mapping) or not value:
                raise ModelError(f"budget.{key} is {value!r}", "a size in mm for each joint, {DIP: 0.6, …}")
            sizes = dict(base.tendon_point_sd_mm) | {str(j): _size(f"{key}.{j}", x) for j, x in value.items()}
            values[key] = tuple(sizes.items())
        else:
            values[key] = _size(key, value)
    return replace(base, name="session", **values)


def _size(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value) or value < 0:
        raise ModelError(f"budget.{key} is {value!r}", "a finite number that is not negative")
    return float(value)


def anatomy_parameters(finger: Finger, budget: Budget) -> tuple[Parameter, ...]:
    """Declare tendon points [mm, absolute] and hood fractions, in the order that `model.with_anatomy` reads them."""
    topology, values = finger.topology, finger.values
    sizes = dict(budget.tendon_point_sd_mm)
    joints = [joint.name for joint in topology.joints]
    strange = [name for name in sizes if name not in joints and name not in dict(CERTIFICATE.tendon_point_sd_mm)]
    if strange:
        raise ModelError(
            f"budget.tendon_point_sd_mm names {strange[0]!r}", f"joints of {finger.id}: {', '.join(joints)}"
        )
    out: list[Parameter] = []
    for end, points in (("proximal", values.proximal_point), ("distal", values.distal_point)):
        for segment, point in zip(topology.segments, points, strict=True):
            sd = sizes.get(segment.joint, max(sizes.values())) * finger.prior_width
            # Bounds of the published identification: 10 mm at the DIP and PIP, 20 mm at the MCP.
            reach = 20.0 if segment.joint == topology.joints[0].name else 10.0
            for axis, value, width in zip("xyz", point, (1.0, 1.0, 0.5), strict=True):
                name = f"point.{segment.name}.{end}.{axis}"
                x = float(value)
                out.append(Parameter(name, "mm", x, sd * width, x - reach, x + reach))
    for name, value, prior in zip(topology.fractions, values.fraction, finger.fraction_priors, strict=True):
        sd = budget.fraction_sd * finger.prior_width if prior.sd is None else prior.sd
        out.append(Parameter(f"fraction.{name}", "1", float(value), sd, 0.0, 1.0, centre=prior.centre))
    return tuple(out)


def budget_effects(budget: Budget) -> tuple[Effect, ...]:
    """Return the budget's errors as effects, in the order in which they act."""
    return (TensionFactor(budget), PostureAngles(budget), CellMounting(budget))


@final
@dataclass(frozen=True)
class TensionFactor(Effect):
    """Each pulley passes a little more or less than the session's friction factor says."""

    budget: Budget = field(compare=False, repr=False)  # only the declared priors depend on it, not what is compiled
    always = True
    name = "tension_factor"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One relative error common to all tendons, then one per tendon."""
        b = self.budget
        common = Parameter("tension_factor.common", "1", 0.0, b.tension_factor_common_sd, -0.5, 0.5, "budget")
        return (
            common,
            *(
                Parameter(f"tension_factor.{m}", "1", 0.0, b.tension_factor_sd, -0.5, 0.5, "budget")
                for m in topology.muscles
            ),
        )

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Scale the tensions."""
        return state._replace(tension=state.tension * (1.0 + p[0]) * (1.0 + p[1:]))


@final
@dataclass(frozen=True)
class PostureAngles(Effect):
    """Each joint angle was read a little wrong, once for each setting of a posture."""

    budget: Budget = field(compare=False, repr=False)  # only the declared priors depend on it, not what is compiled
    always = True
    of_each = "setting"
    name = "posture_angle"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One error in degrees for each setting and rotation."""
        return tuple(
            Parameter(
                f"posture_angle.{layout.setting_name(i)}.{rotation}",
                "deg",
                0.0,
                self.budget.angle_sd_deg,
                -30.0,
                30.0,
                "budget",
            )
            for i in range(len(layout.settings))
            for rotation in topology.rotations
        )

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Add the setting's errors to the posture."""
        errors = chosen(p.reshape(-1, state.posture.shape[0]), case.setting)
        return state._replace(posture=state.posture + jnp.deg2rad(errors))


@final
@dataclass(frozen=True)
class CellMounting(Effect):
    """The cell is turned and offset a little in its clamp, its gains are off a little, its tare missed a little."""

    budget: Budget = field(compare=False, repr=False)  # only the declared priors depend on it, not what is compiled
    always = True
    of_each = "mounting"
    name = "cell"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Six gains of the cell; then rotation, zero and offset of each mounting, three axes each."""
        b = self.budget
        out = [
            Parameter(f"cell_gain.{c}", "1", 0.0, b.cell_gain_sd, -0.3, 0.3, "budget")
            for c in ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
        ]
        for i, (location, _) in enumerate(layout.mountings):
            place = layout.mounting_name(i)
            zero_sd = b.zero_bone_sd_N if location == "bone" else b.zero_tip_sd_N
            # Moments are fitted at the tip only, so an offset at the bone would be a parameter without data.
            offset_sd = b.mount_offset_sd_mm if location == "tip" else 0.0
            for group, unit, sd, reach in (
                ("mounting_rotation", "deg", b.cell_rotation_sd_deg, 30.0),
                ("zero", "N", zero_sd, 5.0),
                ("mount_offset", "mm", offset_sd, 50.0),
            ):
                out += [Parameter(f"{group}.{place}.{a}", unit, 0.0, sd, -reach, reach, "budget") for a in "xyz"]
        return tuple(out)

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn, offset, scale and shift the wrench, as the cell would report it."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        errors, zero, offset = chosen(p[6:].reshape(-1, 9), case.mounting).reshape(3, 3)
        angle = jnp.deg2rad(errors)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        rx, ry, rz = (turn_about(axis, cosine[axis], sine[axis]) for axis in range(3))
        force, torque = state.wrench[:3], state.wrench[3:]
        torque = torque - cross(offset, force)
        # Intrinsic x-y-z, so z acts first.
        both = jnp.stack([force, torque], axis=1)
        wrench = (rx @ (ry @ (rz @ both))).T.reshape(6) * (1.0 + p[:6])
        return state._replace(wrench=wrench + jnp.concatenate([zero, jnp.zeros(3)]))
