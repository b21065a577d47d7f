"""Inverse analysis of a measured session: from the force at the tip to what pulled, beside what really hung there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from daq.errors import InputError
from fingermodel.budget import CellMounting
from fingermodel.fingers import COMPONENTS
from fingermodel.inverse.areas import areas_of
from fingermodel.inverse.closures import Closure, closure_of, slip_names
from fingermodel.inverse.spread import Given, Inverse, invert
from fingermodel.session import Session
from fingermodel.stages import LoadCaseInput, State
from fingermodel.studies.inverted import Assigned, Inversion, InvertedCase, MuscleSummary

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Flags = NDArray[np.bool_]
    Rows = NDArray[np.intp]


def invert_bench(bench: Session, closure: str = "chao", seed: int = 0) -> Inversion:
    """Assign muscle, slip and contact forces to every force measured at the tip.

    Args:
        bench: session and model, whose fitted points and rig's errors hold; other effects do not act.
        closure: `minimal`, `chao` or `least_squares`.
        seed: of the draws of `least_squares`.

    Raises:
        InputError: no such closure, or no case at the tip of which enough was read.
        ModelError: a finger that the closure does not fit.
    """
    finger, observations = bench.model.finger, bench.observations
    chosen = closure_of(closure, finger.topology)
    rows, left_out, unread = _readable(bench, chosen)
    given = _given(bench, rows, unread)
    inverse = invert(finger, chosen, given, seed=seed)
    known = np.ones(len(rows), dtype=bool)
    for forces in (inverse.muscle, inverse.muscle_sd, inverse.contact, inverse.contact_norm_sd):
        known &= np.isfinite(forces).reshape(len(rows), -1).all(axis=1)
    if not known.all():
        case = observations.ids[rows[np.argmin(known)]]
        raise InputError(f"closure {closure} has no answer for case {case}", "a posture in which the tendons have arms")
    modelled = _modelled_contacts(bench)[rows]
    hung = np.asarray(observations.inputs.tension)[rows]
    cases = tuple(
        _case(bench, chosen, inverse, k, int(row), hung[k], modelled[k], unread[k]) for k, row in enumerate(rows)
    )
    muscles, found = _summary(bench, chosen, cases)
    return Inversion(
        chosen.name, chosen.title, cases, muscles, found, left_out, _notes(bench, chosen, inverse, left_out, unread)
    )


def _modelled_contacts(bench: Session) -> Floats:
    """Magnitude of the contact forces (n, joints) that the model makes of the weights that hung [N]."""
    joint = np.asarray(bench.model.predict(bench.observations.inputs, bench.theta).joint)
    size: Floats = np.linalg.norm(joint, axis=2)
    return size


def _readable(bench: Session, closure: Closure) -> tuple[Rows, tuple[str, ...], Flags]:
    """Cases at the tip of which enough was read, the ids of the others, and what was not read of each: (n, 6).

    The force must be there. A moment that the clamp carries too may be missing for `least_squares` alone, which has
    an answer for every moment and can take the one of least stress.
    """
    observations = bench.observations
    at_tip = [i for i, x in enumerate(observations.locations) if x == "tip" and observations.roles[i] != "check"]
    carried = np.zeros(6, dtype=bool)
    carried[list(bench.model.finger.topology.reactions)] = True
    missing: Flags = np.asarray(carried & ~np.isfinite(observations.wrench))
    force_read: Flags = np.asarray(~missing[:, :3].any(axis=1))
    enough: Flags = force_read if closure.name == "least_squares" else np.asarray(~missing.any(axis=1))
    rows = [i for i in at_tip if enough[i]]
    if not rows:
        if not at_tip:
            raise InputError("no case at the tip", "a tip force to invert", "Choose a session with cases at the tip")
        names = ", ".join(COMPONENTS[c] for c in np.flatnonzero(carried))
        if force_read[at_tip].any():
            raise InputError(
                f"no case at the tip of which force and moment were both read, for closure {closure.name}",
                f"{names}, which the clamp carries",
                "Closure least_squares leaves a moment that was not read free",
            )
        raise InputError("no case at the tip of which the force was read", names)
    return np.array(rows), tuple(observations.ids[i] for i in at_tip if not enough[i]), missing[rows]


def _given(bench: Session, rows: Rows, unread: Flags) -> Given:
    """Points, postures and tip wrenches, each with what is known of its error."""
    model, observations = bench.model, bench.observations
    table, theta = model.parameters, np.asarray(bench.theta)
    anatomy = np.flatnonzero(table.of_kind("anatomy"))
    turns = model.finger.topology.rotations
    posture = np.asarray(observations.inputs.posture)[rows].copy()
    sd = np.zeros(len(turns))
    for k, row in enumerate(rows):
        setting = model.layout.setting_name(int(observations.inputs.setting[row]))
        at = [table.index[f"posture_angle.{setting}.{turn}"] for turn in turns]
        posture[k] += np.deg2rad(theta[at])
        sd = np.deg2rad(table.sd[at])
    wrench, covariance = _tip_wrenches(bench, rows)
    return Given(
        anatomy=theta[anatomy],
        anatomy_sd=table.sd[anatomy],
        anatomy_lower=table.lower[anatomy],
        anatomy_upper=table.upper[anatomy],
        posture=posture,
        posture_sd=sd,
        wrench=wrench,
        wrench_covariance=covariance,
        unread=unread,
    )


def _tip_wrenches(bench: Session, rows: Rows) -> tuple[Floats, Floats]:
    """What the finger did to the clamp (n, 6), the cell's own errors taken out as far as known, and its covariance.

    Components that the finger's clamp does not carry are zero.
    """
    import jax
    import jax.numpy as jnp

    model, observations = bench.model, bench.observations
    structure = model.structure
    index = next(i for i, e in enumerate(structure.effects) if isinstance(e, CellMounting))
    cell, (first, last) = structure.effects[index], structure.slices[index]
    p, sd = jnp.asarray(bench.theta)[first:last], np.asarray(model.parameters.sd[first:last])
    values = model.finger.values

    def read(case: LoadCaseInput, parameters: Any, wrench: Any) -> Any:
        state = State(structure.topology, case.posture, values, case.tension, wrench=wrench)
        return cell.reading(parameters, case, state).wrench

    @jax.jit
    def slopes(case: LoadCaseInput, wrench: Any) -> Any:
        return read(case, p, jnp.zeros(6)), jax.jacfwd(read, 2)(case, p, wrench), jax.jacfwd(read, 1)(case, p, wrench)

    carried = np.zeros(6, dtype=bool)
    carried[list(structure.topology.reactions)] = True
    wrenches, covariances = np.zeros((len(rows), 6)), np.zeros((len(rows), 6, 6))
    own = observations.case_covariance
    for k, row in enumerate(rows):
        case = LoadCaseInput(*(x[row] for x in observations.inputs))
        measured = np.nan_to_num(observations.wrench[row])
        zero, matrix, _ = (np.asarray(x) for x in slopes(case, jnp.asarray(measured)))
        back = np.linalg.inv(matrix)
        wrench = back @ (measured - zero)
        _, _, by_parameter = (np.asarray(x) for x in slopes(case, jnp.asarray(wrench)))
        spread = by_parameter * sd
        both = back @ (np.nan_to_num(own[row]) + spread @ spread.T) @ back.T
        wrenches[k] = np.where(carried, wrench, 0.0)
        covariances[k] = both * np.outer(carried, carried)
    return wrenches, covariances


def _case(
    bench: Session,
    closure: Closure,
    inverse: Inverse,
    k: int,
    row: int,
    hung: Floats,
    modelled: Floats,
    unread: Flags,
) -> InvertedCase:
    observations, topology = bench.observations, bench.model.finger.topology
    pulled = dict(zip(topology.muscles, hung, strict=True))
    muscles = {
        m.name: Assigned(
            float(inverse.muscle[k, j]), float(inverse.muscle_sd[k, j]), float(sum(pulled[x] for x in m.merged))
        )
        for j, m in enumerate(closure.muscles)
    }
    slips = {
        name: Assigned(float(inverse.slip[k, j]), float(inverse.slip_sd[k, j]), None)
        for j, name in enumerate(slip_names(topology))
    }
    joints = [joint.name for joint in topology.joints]
    size = np.linalg.norm(inverse.contact[k], axis=1)
    return InvertedCase(
        id=observations.ids[row],
        role=observations.roles[row],
        posture=observations.postures[row],
        masses_g=observations.masses_g[row],
        muscles=muscles,
        slips=slips,
        contacts={
            name: Assigned(float(size[j]), float(inverse.contact_norm_sd[k, j]), float(modelled[j]))
            for j, name in enumerate(joints)
        },
        contacts_N={name: inverse.contact[k, j].tolist() for j, name in enumerate(joints)},
        pushes=tuple(name for name, a in muscles.items() if a.force_N < -1e-9),
        unbalanced_Nmm=float(np.linalg.norm(inverse.unbalanced[k])),
        unread=tuple(COMPONENTS[c] for c in np.flatnonzero(unread)),
    )


def _summary(
    bench: Session, closure: Closure, cases: tuple[InvertedCase, ...]
) -> tuple[tuple[MuscleSummary, ...], int]:
    budget = bench.model.budget
    # What hung is known but for the pulleys.
    pulley = float(
        np.sqrt(budget.tension_factor_sd**2 + budget.tension_factor_common_sd**2 + budget.tension_factor_case_sd**2)
    )
    inside = np.zeros((len(cases), len(closure.muscles)), dtype=bool)
    out = []
    for j, muscle in enumerate(closure.muscles):
        mine = [case.muscles[muscle.name] for case in cases]
        force, sd = np.array([a.force_N for a in mine]), np.array([a.sd_N for a in mine])
        hung = np.array([a.hung_N or 0.0 for a in mine])
        inside[:, j] = np.abs(force - hung) <= 2.0 * np.hypot(sd, pulley * hung)
        out.append(
            MuscleSummary(
                muscle.name,
                muscle.merged,
                float(np.sqrt(np.mean((force - hung) ** 2))),
                int(inside[:, j].sum()),
                int((force < -1e-9).sum()),
                int((force < -np.maximum(2.0 * sd, 1e-9)).sum()),
            )
        )
    return tuple(out), int(inside.all(axis=1).sum())


def _notes(
    bench: Session, closure: Closure, inverse: Inverse, left_out: tuple[str, ...], unread: Flags
) -> tuple[str, ...]:
    notes = []
    if left_out:
        notes.append(f"Left out, since too little of what the clamp carries was read: {', '.join(left_out)}.")
    if unread.any():
        which = ", ".join(COMPONENTS[c] for c in np.flatnonzero(unread.any(axis=0)))
        notes.append(
            f"{which} was not read in {int(unread.any(axis=1).sum())} of {len(unread)} cases: it may take any value "
            "there, and the muscles have one equation less to meet."
        )
    if bench.loaded.added:
        names = sorted({str(p).split(".")[0] for p in bench.loaded.added})
        notes.append(f"The model's effects do not act here, only its points and the rig's errors: {', '.join(names)}.")
    if closure.name == "least_squares":
        short = int((np.linalg.norm(inverse.unbalanced, axis=1) > 0.0).sum())
        if short:
            notes.append(
                f"In {short} of {len(inverse.unbalanced)} cases no tensions that pull make the torque that was read; "
                "the nearest stand there."
            )
        notes.append(f"PCSA: {areas_of(bench.model.finger).source}.")
    return tuple(notes)
