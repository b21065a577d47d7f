"""From readings to one wrench a load case: tare and its drift, plateaus, mount axes, known weights, friction.

One pass over the readings; each window is reduced when it is complete.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import SessionError
from daq.measured import MeasuredCase, MeasuredCheck, MeasuredSession, Tare
from daq.recordings.columns import HEADERS
from daq.recordings.plateaus import Plateau
from daq.recordings.readings import ReadingBlock, open_readings
from daq.recordings.windows import Span, gather
from daq.sessions.models import KnownWeight, LoadCase, Session, TensionEstimate
from daq.sessions.mountings import mounting_of
from daq.signals.calibration import MountTransform, mount_transform
from daq.signals.tension_estimate import estimated_tension
from daq.signals.tension_scatter import is_asked, tension_scatter
from daq.vocabulary import OTHER_MOUNT

Floats = NDArray[np.float64]

# Windows of which one says that they creep; standard uncertainties from which on that is not the noise.
_FEWEST, _SHOWN_SD = 6, 3.0
Progress = Callable[[float], None]


def measure(session: Session, progress: Progress | None = None) -> MeasuredSession:
    """Correct a session's readings.

    Args:
        session: as read from its folder.
        progress: is told the share of the recording that has been read, 0 to 1.

    Raises:
        ReadingsError: the readings cannot be used, or a window lies outside them.
        SessionError: the readings' folder is not known, or the friction correction cannot be estimated.
    """
    session = session.amended
    return assemble(session, *gathered(session, progress))


def gathered(
    session: Session,
    progress: Progress | None = None,
    watch: Callable[[Iterator[ReadingBlock]], Iterator[ReadingBlock]] | None = None,
) -> tuple[Mapping[Span, Plateau], tuple[str, ...]]:
    """Read a session's windows.

    Args:
        session: as read from its folder, amendments heeded.
        progress: is told the share of the recording that has been read, 0 to 1.
        watch: sees every block of the recording on its way.

    Returns:
        Plateaus by window, and notes on the recording; nothing where there are only averaged forces.
    """
    windows = windows_of(session)
    if not windows:
        return {}, ()
    path = session.readings_path
    if path is None:
        raise SessionError(
            f"session {session.id} has windows, but its folder is not known", "a session read from its folder"
        )
    source = open_readings(path)
    blocks = source.blocks() if watch is None else watch(source.blocks())
    plateaus = gather(blocks, windows, path.name, progress).plateaus
    return plateaus, (*(f"converted {c}" for c in source.conversions), *source.notes)


def assemble(session: Session, plateaus: Mapping[Span, Plateau], notes: tuple[str, ...] = ()) -> MeasuredSession:
    """Make a measured session from its reduced windows."""
    session = session.amended
    cases = [c for c in session.cases if c.excluded is None]
    mounts = session.load_cell.mounts if session.load_cell else {}
    transforms = {m: mount_transform(mounts.get(m), session.specimen.side) for m in ("tip", "bone")}
    tares, index = _tares(cases, plateaus, transforms)
    weights = np.zeros((len(cases), len(tares)))
    drift = _drift_per_s(cases, tares, index)
    dead = _dead_channels(plateaus)
    # A force is left as it is: `MeasuredSession.require_forces` says so to whoever would fit it.
    dead_moments = dead & (np.arange(6) >= 3)
    unread = {mount: (transform.matrix != 0.0) @ dead_moments for mount, transform in transforms.items()}
    to_other_mount = {m: transforms[o].matrix @ np.linalg.inv(transforms[m].matrix) for m, o in OTHER_MOUNT.items()}
    measured = []
    for row, case in enumerate(cases):
        if case.loaded_s is None or case.unloaded_s is None:
            measured.append(_averaged(case))
            continue
        plateau, transform = plateaus[case.loaded_s], transforms[case.location]
        before = index[case.location, case.unloaded_s]
        wrench = transform.apply(plateau.mean)
        covariance = transform.apply_covariance(plateau.covariance)
        if case.unloaded_after_s is None:
            weights[row, before] = 1.0
        else:
            after = index[case.location, case.unloaded_after_s]
            t0, t, t1 = tares[before].mid_s, plateau.mid_s, tares[after].mid_s
            _require_between(case, t0, t, t1)
            share = (t - t0) / (t1 - t0)
            weights[row, before], weights[row, after] = 1.0 - share, share
            covariance = covariance + np.diag(drift[row] * (t - t0) * (t1 - t) / (t1 - t0))
        for k in np.flatnonzero(weights[row]):
            wrench = wrench - weights[row, k] * tares[k].mean
        wrench[unread[case.location]] = np.nan
        measured.append(
            MeasuredCase(
                case=case,
                wrench=wrench,
                covariance=covariance,
                loaded_mid_s=plateau.mid_s,
                unloaded_mid_s=tares[before].mid_s,
                steady=plateau.steady,
                plateau=plateau,
                has_torque=not unread[case.location].any(),
                noise_stated=True,
                to_other_mount=to_other_mount[case.location],
            )
        )
    checks = tuple(_check(w, plateaus, transforms[w.mount], session) for w in session.checks)
    stated = session.tension_factor
    out = MeasuredSession(
        session=session,
        cases=tuple(measured),
        tares=tuple(tares),
        tare_weights=weights,
        checks=checks,
        tension_factor=np.nan if isinstance(stated, TensionEstimate) else float(stated),
        tension_factor_source="stated by the session",
        notes=notes,
        creep=_creep(measured, transforms),
        dead_forces=tuple(name for name, is_dead in zip(HEADERS[1:4], dead[:3], strict=True) if is_dead),
        plateaus=plateaus,
    )
    if isinstance(stated, TensionEstimate):
        out = _with_estimate(out)
    if is_asked(session.budget):
        scatter, said = tension_scatter(out)
        out = replace(out, tension_case_sd=scatter, notes=(*notes, said))
    return out


def as_entered(measured: MeasuredSession) -> MeasuredSession:
    """The same readings under the entries as they were made; a case that an amendment left out stays out.

    A friction correction that was estimated stays, too: with wrong entries it may be out of reach.
    """
    counted, entered = {m.case.id for m in measured.cases}, measured.session.unamended
    cases = tuple(case for case in entered.cases if case.id in counted)
    stated = entered.model_copy(update={"cases": cases, "tension_factor": measured.tension_factor})
    return replace(
        assemble(stated, measured.plateaus),
        session=entered,
        tension_factor_source=measured.tension_factor_source,
        estimated_tension=measured.estimated_tension,
        notes=measured.notes,
    )


def _creep(measured: list[MeasuredCase], transforms: Mapping[str, MountTransform]) -> float:
    """Share of its force by which a loaded reading usually changes within its window; 0 where noise may make that."""
    found = []
    for m in measured:
        if m.plateau is not None and (size := float(m.wrench[:3] @ m.wrench[:3])) > 0.0:
            change = m.plateau.slope_per_s * (m.plateau.end_s - m.plateau.start_s)
            found.append(float(transforms[m.case.location].apply(change)[:3] @ m.wrench[:3]) / size)
    if len(found) < _FEWEST:
        return 0.0
    usual = float(np.median(found))
    # Of a median, by the spread of the middle of what it is of: windows that hold a change of load are far out.
    sd = 1.253 * 1.483 * float(np.median(np.abs(np.array(found) - usual))) / np.sqrt(len(found))
    return usual if abs(usual) > _SHOWN_SD * sd else 0.0


def _with_estimate(measured: MeasuredSession) -> MeasuredSession:
    found = estimated_tension(measured)
    pairs = f"{found.pairs} pairs of cases" if found.pairs > 1 else "one pair of cases"
    source = f"estimated by force balance from {pairs}, ± {found.sd:.3f}"
    return replace(measured, tension_factor=found.value, tension_factor_source=source, estimated_tension=found)


def windows_of(session: Session) -> dict[Span, str]:
    """Collect a session's windows, each once, named after the first case that has it; excluded cases have none."""
    out: dict[Span, str] = {}
    for case in session.cases:
        if case.excluded is None:
            for key, window in case.windows():
                out.setdefault(window, f"case {case.id}: {key}")
    for i, check in enumerate(session.checks):
        out.setdefault(check.unloaded_s, f"checks[{i}]: unloaded_s")
        out.setdefault(check.loaded_s, f"checks[{i}]: loaded_s")
    return out


def _dead_channels(plateaus: Mapping[Span, Plateau]) -> NDArray[np.bool_]:
    """Say which of the cell's channels (6,) never change, in any window.

    Such a channel is a wire that is broken, or a column of a three-axis recording that was filled in. Its readings are
    no measured zeros.
    """
    means = np.array([p.mean for p in plateaus.values()]).reshape(-1, 6)
    steps = np.array([p.step for p in plateaus.values()]).reshape(-1, 6)
    same = np.isclose(means, means[:1], rtol=1e-12, atol=1e-12).all(axis=0)
    return np.asarray(~steps.any(axis=0) & same & (len(means) > 1))


def _tares(
    cases: list[LoadCase], plateaus: Mapping[Span, Plateau], transforms: Mapping[str, MountTransform]
) -> tuple[list[Tare], dict[tuple[str, Span], int]]:
    """Bring every tare that occurs to mount axes, and say where each one is."""
    tares: list[Tare] = []
    index: dict[tuple[str, Span], int] = {}
    for case in cases:
        for window in (case.unloaded_s, case.unloaded_after_s):
            if window is None or (case.location, window) in index:
                continue
            plateau, transform = plateaus[window], transforms[case.location]
            index[case.location, window] = len(tares)
            tares.append(
                Tare(
                    mean=transform.apply(plateau.mean),
                    covariance=transform.apply_covariance(plateau.covariance),
                    mid_s=plateau.mid_s,
                    location=case.location,
                    window_s=window,
                )
            )
    return tares, index


def _drift_per_s(cases: list[LoadCase], tares: list[Tare], index: Mapping[tuple[str, Span], int]) -> Floats:
    """Return the variance (cases, 6) by which the zero wanders in a second, for cases between two tares.

    It is the square of the tares' difference over the time between them, the larger of the case's own pair and the
    mean over all pairs. That counts a straight drift, which interpolation removes, and the tares' noise as wandering:
    it errs on the safe side.
    """
    rates = np.zeros((len(cases), 6))
    pairs = {}
    for row, case in enumerate(cases):
        if case.unloaded_s is None or case.unloaded_after_s is None:
            continue
        before, after = index[case.location, case.unloaded_s], index[case.location, case.unloaded_after_s]
        gap = tares[after].mid_s - tares[before].mid_s
        if gap > 0.0:
            rates[row] = (tares[after].mean - tares[before].mean) ** 2 / gap
            pairs[before, after] = rates[row]
    if not pairs:
        return rates
    typical = np.mean(list(pairs.values()), axis=0)
    return np.maximum(rates, typical)


def _require_between(case: LoadCase, t0: float, t: float, t1: float) -> None:
    if not t0 < t < t1:
        raise SessionError(
            f"case {case.id}: loaded_s does not lie between its two tares",
            "unloaded_s, then loaded_s, then unloaded_after_s",
            "Correct the windows",
        )


def _averaged(case: LoadCase) -> MeasuredCase:
    wrench = np.full(6, np.nan)
    wrench[:3] = case.force_N
    if case.torque_Nmm is not None:
        wrench[3:] = case.torque_Nmm
    covariance = np.zeros((6, 6))
    if case.force_cov_N2 is not None:
        covariance[:3, :3] = case.force_cov_N2
    elif case.force_sd_N is not None:
        covariance[:3, :3] = np.diag(np.square(case.force_sd_N))
    return MeasuredCase(
        case=case,
        wrench=wrench,
        covariance=covariance,
        loaded_mid_s=None,
        unloaded_mid_s=None,
        steady=None,
        plateau=None,
        has_torque=case.torque_Nmm is not None,
        noise_stated=case.force_cov_N2 is not None or case.force_sd_N is not None,
    )


def _check(
    weight: KnownWeight, plateaus: Mapping[Span, Plateau], transform: MountTransform, session: Session
) -> MeasuredCheck:
    loaded, unloaded = plateaus[weight.loaded_s], plateaus[weight.unloaded_s]
    return MeasuredCheck(
        force_N=np.array(weight.direction) * weight.mass_g * 1e-3 * session.gravity_m_s2,
        wrench=transform.apply(loaded.mean - unloaded.mean),
        covariance=transform.apply_covariance(loaded.covariance + unloaded.covariance),
        when=weight.when,
        mount=weight.mount,
        mass_g=weight.mass_g,
        mounting=mounting_of(weight, session),
    )
