"""A simulated rig: a finger model and a load-cell's signal write a bench session, of any length.

It serves tests, and a user who plans an experiment: simulate the protocol, refit it, and see what it would determine.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from daq.recordings.readings import write_readings
from daq.sessions import Session, parse_session, read_session, write_session
from daq.sessions.protocols import PlannedCase, Protocol, plan
from daq.standins.simulated import LoadStep, SimulatedCell, readings
from daq.vocabulary import did_you_mean
from fingermodel.budget import CERTIFICATE, Budget
from fingermodel.comparison.observations import posture_rad, require_usable
from fingermodel.effects.catalogue import CATALOGUE
from fingermodel.fingers import Finger
from fingermodel.model import Model
from fingermodel.parameters import with_unit
from fingermodel.stages import Effect, Layout, LoadCaseInput

Floats = NDArray[np.float64]


# Fewer say nothing about their own scatter.
LEAST_READINGS = 5


def simulate_session(
    finger: Finger,
    protocol: Protocol,
    folder: Path,
    *,
    cell: SimulatedCell | None = None,
    seed: int = 0,
    session_id: str = "simulated",
    finger_name: str | None = None,
    budget: Budget = CERTIFICATE,
    effects: tuple[Effect, ...] = CATALOGUE,
    truth: Mapping[str, float] | None = None,
    tension_factor: float = 0.835,
    friction_band: float = 0.0,
    repeats: int = 1,
    readings_name: str = "readings.csv.gz",
) -> tuple[Session, dict[str, Floats]]:
    """Write the session that a rig with this finger would record.

    Args:
        finger: the truth that the rig embodies.
        protocol: what is loaded, where and when.
        folder: to write `session.yaml` and the readings into.
        cell: the load cell.
        seed: of the cell's noise and of the unloaded readings.
        session_id: of the new session.
        finger_name: that the session names, by default the finger's own id (so that a perturbed truth can name the
            model that the user would start from).
        budget: declares which of the rig's errors may be set by `truth`.
        effects: that `truth` may let act, each at its null otherwise.
        truth: parameter values by name that differ from their null, each in its parameter's unit, such as
            `{"zero.bone.x": 0.3, "hanger_mass.m0": 30.0}`.
        tension_factor: friction factor c of the rig.
        friction_band: share of the tension that friction takes on loading and adds on unloading, until tapped.
        repeats: how often the protocol is run.
        readings_name: .csv, .csv.gz or .parquet.

    Returns:
        The session as read back, and the noise-free wrench (6,) of every case [N, N mm].

    Raises:
        InputError: too few readings in a window, or a parameter in `truth` that the rig lacks or beyond its bounds.
        SessionError: a posture or tendon that the finger does not have.
    """
    cell = cell or SimulatedCell()
    cases, end_s = plan(protocol, repeats)
    shortest = min(end - start for c in cases for start, end in (c.unloaded_s, c.loaded_s))
    if shortest * cell.rate_hz < LEAST_READINGS:
        raise InputError(
            f"{cell.rate_hz:g} Hz leaves {shortest * cell.rate_hz:.1f} readings in a window of {shortest:g} s",
            f"at least {LEAST_READINGS}",
            "Sample faster, or hold each load longer",
        )
    document = _document(protocol, cases, session_id, finger_name or finger.id, tension_factor, cell, readings_name)
    session, faults = parse_session(document, None, "the simulated session")
    if session is None:
        raise faults[0]
    require_usable(session, finger)
    model = rig_model(finger, protocol, effects, budget)
    theta = _theta(model, truth or {})
    inputs = _inputs(finger, protocol, cases, model.layout, tension_factor, friction_band)
    wrench = np.asarray(model.predict(inputs, theta).reading)
    steps = _steps(cases, wrench, seed)
    folder.mkdir(parents=True, exist_ok=True)
    write_readings(folder / readings_name, readings(cell, steps, end_s, seed + 1))
    write_session(session, folder)
    return read_session(folder), {c.id: wrench[i] for i, c in enumerate(cases)}


def rig_model(
    finger: Finger, protocol: Protocol, effects: tuple[Effect, ...] = CATALOGUE, budget: Budget = CERTIFICATE
) -> Model:
    """Return the model of a rig that follows a protocol: its parameters are those that a `truth` may set.

    Args:
        finger: that the rig embodies.
        protocol: whose postures and places the cell sees.
        effects: of the model, at their null.
        budget: declares the rig's errors.
    """
    cases, _ = plan(protocol)
    settings = dict.fromkeys((c.posture, 0) for c in cases)
    return Model(finger, Layout(tuple(settings), tuple(dict.fromkeys((c.location, 0) for c in cases))), budget, effects)


def _theta(model: Model, truth: Mapping[str, float]) -> Floats:
    """The model's parameters (parameters,) with some set by name.

    Raises:
        InputError: a name that the model lacks, or a value beyond the parameter's bounds.
    """
    table, theta = model.parameters, model.initial
    for name, value in truth.items():
        if name not in table.index:
            own = [p for p in table if p.kind == "effect" and p.name.split(".")[0] == name.split(".")[0]]
            known = ", ".join(f"{p.name} [{p.unit}]" for p in own) or "the name of an effect's parameter"
            near = did_you_mean(name, table.names) or "See `fingertwin effects`"
            raise InputError(f"no parameter {name!r} in this rig", known, "" if own else near)
        parameter = table.parameters[table.index[name]]
        if not parameter.lower <= value <= parameter.upper:
            most = with_unit(f"{parameter.upper:g}", parameter.unit)
            raise InputError(f"{name} is {value:g}", f"from {parameter.lower:g} to {most}")
        theta[table.index[name]] = value
    return theta


def _inputs(
    finger: Finger,
    protocol: Protocol,
    cases: tuple[PlannedCase, ...],
    layout: Layout,
    tension_factor: float,
    friction_band: float,
) -> LoadCaseInput:
    muscles = finger.topology.muscles
    end_s = max(c.loaded_s[1] for c in cases)
    tension = np.zeros((len(cases), len(muscles)))
    unloading = [c.reading.direction == "unloading" for c in cases]
    for i, case in enumerate(cases):
        held = 0.0 if case.reading.tapped else friction_band if unloading[i] else -friction_band
        for muscle, mass in case.masses_g.items():
            tension[i, muscles.index(muscle)] = mass * 9.81e-3 * tension_factor * (1.0 + held)
    postures = {n: posture_rad(finger.topology, p, f"posture {n}") for n, p in protocol.postures_deg.items()}
    return LoadCaseInput.batch(
        posture=[postures[c.posture] for c in cases],
        tension=tension,
        at_bone=[c.location == "bone" for c in cases],
        known_force=np.zeros((len(cases), 3)),
        is_check=np.zeros(len(cases), bool),
        setting=[layout.settings.index((c.posture, 0)) for c in cases],
        mounting=[layout.mountings.index((c.location, 0)) for c in cases],
        weight=np.full(len(cases), 9.81e-3 * tension_factor),
        unloading=unloading,
        since_tare=[(np.mean(c.loaded_s) - np.mean(c.unloaded_s)) / end_s for c in cases],
        elapsed=[np.mean(c.loaded_s) / end_s for c in cases],
    )


def _steps(cases: tuple[PlannedCase, ...], wrench: Floats, seed: int) -> list[LoadStep]:
    """Unloaded reading of each posture block (finger weight and clamping), then each case on top of it."""
    rng = np.random.default_rng(seed)
    steps: list[LoadStep] = []
    rests: dict[tuple[str, str], Floats] = {}
    block_start, rest = -1.0, np.zeros(6)
    for case, load in zip(cases, wrench, strict=True):
        if case.block_start_s != block_start:
            block_start = case.block_start_s
            # The rig's postures are stops of a jig: coming back to one finds it unchanged.
            place = (case.posture, case.location)
            if place not in rests:
                rests[place] = rng.normal(size=6) * np.array([1.5, 1.5, 1.5, 15.0, 15.0, 15.0])
            rest = rests[place]
            steps.append(LoadStep(block_start, rest))
        if case.overload_start_s is not None and case.reading.overload is not None:
            steps.append(LoadStep(case.overload_start_s, rest + case.reading.overload * load))
        steps.append(LoadStep(case.load_start_s, rest + load))
    return steps


def _document(
    protocol: Protocol,
    cases: tuple[PlannedCase, ...],
    session_id: str,
    finger_name: str,
    tension_factor: float,
    cell: SimulatedCell,
    readings_name: str,
) -> dict[str, Any]:
    locations = dict.fromkeys(c.location for c in cases)
    frames = {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}}
    return {
        "format": "bench-session/1",
        "id": session_id,
        "specimen": {"id": session_id, "species": "human", "digit": "third", "side": "right"},
        "finger": finger_name,
        "readings": readings_name,
        "load_cell": {
            "model": "ATI Nano17-E SI-25-0.25",
            "rate_hz": cell.rate_hz,
            "mounts": {location: frames[location] for location in locations},
        },
        "gravity_m_s2": 9.81,
        "tension_factor": tension_factor,
        "postures_deg": protocol.postures_deg,
        "protocol": protocol.id,
        "provenance": {"made_by": "fingertwin simulate", "protocol": protocol.id},
        "cases": [
            {
                "id": c.id,
                "role": c.role,
                "posture": c.posture,
                "location": c.location,
                "masses_g": c.masses_g,
                "unloaded_s": [round(x, 6) for x in c.unloaded_s],
                "loaded_s": [round(x, 6) for x in c.loaded_s],
                **c.told(),
            }
            for c in cases
        ],
    }
