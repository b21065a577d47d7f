"""Sums of readings that must vanish, with all that may keep them from it: noise, shared tares, the rig's budget.

Nothing here knows a tendon point. What the budget's errors change is worked out from the measured forces themselves:
a turned cell turns what was read, a wrong angle changes it by the posture's Jacobian at the joint torques in question.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from fingermodel.arrays import Floats, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.answer import Residuals, figure
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges

K = TypeVar("K", bound=Hashable)

# Nobody reads a cell better than this: 1 mN and 0.02 N mm.
_FLOOR = np.array([1e-3] * 3 + [2e-2] * 3)
# A moment arm changes with its joint's angle by its own length a radian, as far as is known without tendon points.
_ARM_PER_RAD = 1.0
# The product of two normal errors has long tails: it counts as a normal one of this many standard deviations.
_PRODUCT = 2.0
# (e_a × v)_b = Σ_c _CROSS[a, b, c] v_c.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).swapaxes(1, 2)


@dataclass(frozen=True, eq=False)
class Readings(CaseChanges):
    """A session's wrenches with what one standard deviation of each budget error changes in them.

    Of the model only the bones, the joints, the sutures' direction and the budget are used.
    """

    observations: Observations  # of the session

    @cached_property
    def wrench(self) -> Floats:
        """(n, 6) [N, N mm], zero where not read."""
        return np.nan_to_num(self.observations.wrench)

    @cached_property
    def read(self) -> Mask:
        """(n, 6) whether it was."""
        return np.isfinite(self.observations.wrench)

    @cached_property
    def tension(self) -> Floats:
        """(n, muscles) [N]."""
        return np.asarray(self.inputs.tension)

    @cached_property
    def at_bone(self) -> Mask:
        """(n,) whether the cell was at the bone."""
        return np.asarray(self.inputs.at_bone)

    @cached_property
    def loaded(self) -> list[int]:
        """Indices of the cases in which a weight hangs, in order."""
        usable = self.read[:, :3].all(axis=1) & (self.load > 0.0) & ~np.asarray(self.inputs.is_check)
        return np.flatnonzero(usable).tolist()

    @cached_property
    def masses(self) -> tuple[tuple[tuple[str, float], ...], ...]:
        """What hangs in each case, by name of the tendon."""
        return tuple(tuple(sorted((k, v) for k, v in m.items() if v > 0.0)) for m in self.observations.masses_g)

    @cached_property
    def mix(self) -> tuple[tuple[tuple[str, float], ...], ...]:
        """Which tendons are loaded in which proportion in each case."""
        totals = [sum(v for _, v in m) for m in self.masses]
        return tuple(
            tuple((k, round(v / t, 6)) for k, v in m) if t > 0.0 else ()
            for m, t in zip(self.masses, totals, strict=True)
        )

    @cached_property
    def setting(self) -> list[int]:
        """Setting of each case's posture."""
        return np.asarray(self.inputs.setting).tolist()

    @cached_property
    def mounting(self) -> list[int]:
        """Mounting of the cell in each case."""
        return np.asarray(self.inputs.mounting).tolist()

    @cached_property
    def unloading(self) -> list[bool]:
        """Whether weight had come off last."""
        return np.asarray(self.inputs.unloading).tolist()

    def place(self, case: int) -> tuple[str, str]:
        """Posture and mount of a case."""
        return self.observations.postures[case], self.observations.locations[case]

    def stood(self, case: int) -> tuple[object, ...]:
        """Posture, mount, setting and mounting: nothing was touched between cases that have the same."""
        return (*self.place(case), self.setting[case], self.mounting[case])

    @property
    def load(self) -> Floats:
        """(n,) sum of the tensions [N]."""
        return self.tension.sum(axis=1)

    def at(self, location: str) -> list[int]:
        """Loaded cases that were read there."""
        return [i for i in self.loaded if self.observations.locations[i] == location]

    def groups(self, cases: Iterable[int], key: Callable[[int], K]) -> dict[K, list[int]]:
        """Sort cases by what they have in common."""
        out: dict[K, list[int]] = defaultdict(list)
        for i in cases:
            out[key(i)].append(i)
        return dict(out)

    @cached_property
    def both_ends(self) -> list[tuple[list[int], list[int]]]:
        """Cases at the tip and at the bone with the same load in the same posture."""

        def load(i: int) -> tuple[object, ...]:
            return self.observations.postures[i], self.masses[i], self.unloading[i]

        tips, bones = self.groups(self.at("tip"), load), self.groups(self.at("bone"), load)
        return [(tips[k], bones[k]) for k in bones if k in tips]

    def name(self, case: int, *, mount: bool = True) -> str:
        """A load case in words: `FDP 950 g + LU 45 g in hook at the tip`."""
        hung = " + ".join(f"{k} {v:.4g} g" for k, v in self.masses[case])
        place = f" at the {self.observations.locations[case]}" if mount else ""
        return f"{hung} in {self.observations.postures[case]}{place}"

    def worst(self, residual: Residuals, cases: Sequence[int], *, mount: bool = True) -> str:
        """The case whose force stands out most, in words: `FDP 950 g in hook at the tip (0.31 N)`."""
        k, size = residual.worst()
        return f"{self.name(cases[k], mount=mount)} ({figure(size)} N)"

    def newton_per_gram(self, case: int) -> float:
        """What a gram pulls at the finger."""
        return float(np.asarray(self.inputs.weight)[case])

    def forces(self, weights: Floats) -> Residuals:
        """Sums of forces: weights (k, n) of the cases give 3 k residuals, x, y, z of each sum in turn."""
        k, n = weights.shape
        full = np.zeros((k, 3, n, 6))
        for axis in range(3):
            full[:, axis, :, axis] = weights
        return self.residuals(full.reshape(3 * k, n, 6))

    def residuals(self, weights: Floats, constant: Floats | None = None, extra: Floats | None = None) -> Residuals:
        """Sums of components of wrenches.

        Args:
            weights: (k, n, 6).
            constant: (k,) taken from the sums.
            extra: (k, errors) what one standard deviation of further errors changes in them.
        """
        flat = weights.reshape(len(weights), -1)
        own, tared = (weights.swapaxes(0, 1) @ self._noise_by_case).swapaxes(0, 1), flat @ self.observations.noise.tares
        noise = own.reshape(flat.shape) @ flat.T + tared @ tared.T
        spread = [flat @ self.spread, *self._by_angles(weights)]
        if extra is not None:
            spread.append(extra)
        by_budget = np.hstack(spread)
        value = flat @ self.wrench.reshape(-1)
        if constant is not None:
            value = value - constant
        return Residuals(value, noise + by_budget @ by_budget.T, noise, self.observations.noise_assumed)

    def _by_angles(self, weights: Floats) -> list[Floats]:
        """What wrong angles change in the sums of `residuals`.

        Nothing, where a sum stays within one setting and mount: forces that add up then do so at the true angles too.
        Moment arms matter only between settings.
        """
        touched = np.any(weights != 0.0, axis=2)
        both = touched[:, self.at_bone].any(axis=1) & touched[:, ~self.at_bone].any(axis=1)
        anew = np.sum(touched.astype(float) @ self._set > 0.0, axis=1) > 1
        out = []
        for errors, concerned in zip(self.angles, (both | anew, anew), strict=True):
            if concerned.any():
                out.append(concerned[:, None] * (weights.reshape(len(weights), -1) @ errors))
        return out

    @cached_property
    def spread(self) -> Floats:
        """(6 n, errors) what one standard deviation of each budget error changes in the readings, but for angles."""
        b, n = self.model.budget, len(self.wrench)
        gain = np.einsum("nc,cd->ncd", b.cell_gain_sd * self.wrench, np.eye(6)).reshape(6 * n, 6)
        columns = [self._mountings(), gain]
        if b.tension_factor_case_sd:
            scatter = np.einsum("nc,nm->ncm", b.tension_factor_case_sd * self.wrench, np.eye(n))
            columns.append(scatter.reshape(6 * n, n))
        return np.hstack(columns)

    @cached_property
    def _noise_by_case(self) -> Floats:
        """(n, 6, 6) covariance of each case's readings, without the tares that it shares with others.

        In the moments at the tip, the noise of each force has the cell's offset for a lever. Moments are read so finely
        that this may be the most of it. The offset is that of which the moments speak which the clamp does not carry.
        """
        b, out = self.model.budget, self.observations.noise.alone + np.diag(_FLOOR**2)
        free = [c for c in range(3) if c + 3 not in self.model.finger.topology.reactions]
        widths = np.repeat([np.deg2rad(b.cell_rotation_sd_deg), b.mount_offset_sd_mm], 3)
        tips = [i for i in self.at("tip") if self.read[i, 3:].all()]
        for cases in self.groups(tips, lambda i: self.mounting[i]).values():
            covariance = self.observations.case_covariance[cases]
            variance = np.diagonal(covariance, axis1=1, axis2=2)[:, 3:]
            noise = np.sqrt(variance + _FLOOR[3:] ** 2)[:, free]
            h = (
                np.concatenate([self._turned[cases, 1], self._turned[cases, 0]], axis=2)[:, free]
                * widths
                / noise[:, :, None]
            )
            flat, read = h.reshape(-1, 6), (self.wrench[cases, 3:][:, free] / noise).reshape(-1)
            offset = (widths * np.linalg.solve(np.eye(6) + flat.T @ flat, flat.T @ read))[3:]
            lever = np.einsum("abc,a->bc", _CROSS, offset)
            out[cases, 3:, 3:] += lever @ covariance[:, :3, :3] @ lever.T
        return out

    @cached_property
    def _turned(self) -> Floats:
        """(n, force or moment, component, axis) what a turn about each axis makes of every force and moment."""
        return np.einsum("abc,nkc->nkba", _CROSS, self.wrench.reshape(-1, 2, 3))

    def _mountings(self) -> Floats:
        """(6 n, errors) by the cell's rotation, zero and offset in each mounting.

        Moments are read so finely that products of two errors count: a rotation twice over; a rotation of what the
        offset makes of the force; an offset whose lever acts on what gain and zero did to the force.
        """
        b, n = self.model.budget, len(self.wrench)
        places = [location for location, _ in self.observations.layout.mountings]
        zero_sd = np.array([b.zero_bone_sd_N if p == "bone" else b.zero_tip_sd_N for p in places])[self.mounting]
        offset_sd = np.array([b.mount_offset_sd_mm if p == "tip" else 0.0 for p in places])[self.mounting]
        rotation_sd = np.deg2rad(b.cell_rotation_sd_deg)
        # [case, force or moment, component, error]
        own = np.zeros((n, 2, 3, 39))
        both = self.wrench.reshape(n, 2, 3)
        turned = self._turned
        own[..., :3] = rotation_sd * turned
        twice = np.einsum("abc,nkcd->nkbad", _CROSS, turned).reshape(n, 2, 3, 9)
        own[..., 3:12] = _PRODUCT * rotation_sd**2 * twice
        own[:, 0, :, 12:15] = zero_sd[:, None, None] * np.eye(3)
        own[:, 1, :, 15:18] = offset_sd[:, None, None] * turned[:, 0]
        by_gain = np.einsum("abc,nc->nbac", _CROSS, both[:, 0]).reshape(n, 3, 9)
        own[:, 1, :, 18:27] = (_PRODUCT * offset_sd * b.cell_gain_sd)[:, None, None] * by_gain
        own[:, 1, :, 27:36] = (_PRODUCT * offset_sd * rotation_sd)[:, None, None] * twice[:, 0]
        # Each component of their product is the difference of two terms.
        own[:, 1, :, 36:39] = (_PRODUCT * np.sqrt(2.0) * offset_sd * zero_sd)[:, None, None] * np.eye(3)
        member = np.eye(len(places))[self.mounting]
        return np.einsum("nkce,nm->nkcme", own, member).reshape(6 * n, -1)

    @cached_property
    def _set(self) -> Floats:
        """(n, settings) 1 where a case was read in a setting."""
        return np.eye(len(self.observations.layout.settings))[self.setting]

    @cached_property
    def angles(self) -> tuple[Floats, Floats]:
        """(6 n, errors) by the angles of each setting: as the bones see them, and as the tendons do.

        A wrong angle changes the tip force that the same joint torques need, and turns it against the metacarpal. It
        changes the torques too, by the moment arms, each way of loading in its own manner.
        """
        n = len(self.wrench)
        sd = np.deg2rad(self.model.budget.angle_sd_deg)
        tip = self._tip_wrench()
        reactions = list(self.model.finger.topology.reactions)
        spin, velocity = self.jacobian[:, 3:].swapaxes(1, 2), self.jacobian[:, :3].swapaxes(1, 2)
        rotations = spin.shape[1]
        lever = self.jacobian[:, reactions].swapaxes(1, 2)
        # Change of each column i of the Jacobian by an angle j beyond it; [n, j, i].
        moved = np.cross(spin[:, None], velocity[:, :, None]) - np.cross(spin[:, :, None], velocity[:, None])
        spun = -np.cross(spin[:, :, None], spin[:, None])
        change = np.concatenate([moved, spun], axis=-1) * np.tri(rotations, k=-1)[None, :, :, None]
        force = np.zeros((n, 6, rotations))
        force[:, reactions] = -np.linalg.solve(lever, np.einsum("njic,nc->nij", change, tip))
        # The metacarpal sees the tip's force turned as well.
        force[self.at_bone, :3] += np.cross(spin, tip[:, None, :3]).swapaxes(1, 2)[self.at_bone]
        by_angle = self.as_read(force.swapaxes(1, 2)).swapaxes(1, 2)
        torque = np.einsum("nic,nc->ni", lever, tip[:, reactions])
        by_arm = _ARM_PER_RAD * (self.torque_answer * torque[:, :, None]).swapaxes(1, 2)
        own = list(self.groups(range(n), lambda i: (self.setting[i], self.mix[i])).values())
        alike = np.zeros((n, len(own)))
        for group, cases in enumerate(own):
            alike[cases, group] = 1.0
        return (
            np.einsum("ncr,ns->ncsr", sd * by_angle, self._set).reshape(6 * n, -1),
            np.einsum("ncr,ng->ncgr", sd * by_arm, alike).reshape(6 * n, -1),
        )

    def _tip_wrench(self) -> Floats:
        """(n, 6) tip wrench of every case, from its balance where the bone was read and the tip never was."""
        tip = self.wrench.copy()
        read = self.groups(self.at("tip"), lambda i: (self.observations.postures[i], self.masses[i]))
        pull = self.tension @ np.asarray(self.model.finger.values.suture)
        for i in np.flatnonzero(self.at_bone):
            same = read.get((self.observations.postures[i], self.masses[i]))
            if same:
                tip[i] = self.wrench[same].mean(axis=0)
            else:
                tip[i, :3] = (pull[i] - self.wrench[i, :3]) @ self.to_base[i]
                tip[i, 3:] = 0.0
        carried = np.isin(np.arange(6), self.model.finger.topology.reactions)
        return np.where(carried, tip, 0.0)
