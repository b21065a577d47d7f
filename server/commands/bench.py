"""`fingertwin check` and `fingertwin friction`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from daq.checks import measure_and_check
from daq.errors import InputError
from daq.findings import warning_line, warnings_by_session
from daq.quoting import counted
from daq.sessions import read_session, require_once
from daq.signals.friction import friction
from server.application.checking import check_whole
from server.commands.console import answer, progress, say, table

if TYPE_CHECKING:
    from daq.checks import CheckReport
    from daq.signals.friction_bands import BandMean, FrictionBand


def check_session(session: str, json: str | None) -> None:
    """Check a session and show what was found.

    Raises:
        InputError: anything makes it unusable; the answer has been given.
    """
    with progress("Reading"):
        report = check_whole(session)
    body = report.as_dict()
    if not answer("check", {k: v for k, v in body.items() if k != "schema"}, json):
        _say_findings(session, report)
    if not report.ok:
        errors = counted(len(report.errors), "error")
        raise InputError(f"{session}: not usable; {errors}, the first: {report.errors[0].line}")


def _say_findings(session: str, report: CheckReport) -> None:
    counts = {level: sum(f.level == level for f in report.findings) for level in ("error", "warning", "note")}
    verdict = "usable" if report.ok else "not usable"
    say(f"{session}: {verdict}; " + ", ".join(counted(n, level) for level, n in counts.items()))
    for finding in report.findings:
        say(f"{finding.level:8} {finding.line}")


def friction_of(sessions: list[str], json: str | None) -> None:
    """Balance forces at tip and bone over sessions."""
    require_once(sessions)
    with progress("Reading"):
        checked = [measure_and_check(read_session(s)) for s in sessions]
        result = friction([measured for measured, _ in checked])
    warnings = warnings_by_session([(m.session.id, found) for m, found in checked])
    body = result.as_dict() | {"warnings": warnings}
    if answer("friction", {k: v for k, v in body.items() if k != "schema"}, json):
        return
    for warning in warnings:
        say(warning_line(warning))
    # Sessions that only know loading need no word about it.
    told = bool(result.directions)
    table(
        "Friction factor by force balance: tension = c m g",
        ["session", "posture", "masses [g]", *["direction"] * told, "sum m g [N]", "c", "along", "across", ""],
        [
            [
                c.session,
                c.posture,
                _masses(c.masses_g),
                *[c.direction] * told,
                c.weight_N,
                c.factor,
                c.along,
                c.across,
                "c > 1" if c.above_one else "",
            ]
            for c in result.cases
        ],
        "c: norm of tip + bone over the weight (Eq 1); along and across the metacarpal's axis, over the weight",
    )
    table(
        "Means",
        ["", "n", "specimens", "c", "sd", "standard uncertainty", "95 % low", "high", "along", "across"],
        [
            [m.name, m.n, m.specimens, f"{m.factor:.4f}", m.sd, m.sem, m.low, m.high, m.along, m.across]
            for m in (*result.specimens, *result.directions, result.pooled)
        ],
        "pooled: clustered by specimen, since cases of one specimen are not independent",
    )
    if result.band is not None:
        _say_bands(result.bands, result.band)
    for text in (*result.unpaired, *result.notes):
        say(f"Note: {text}")


def _say_bands(bands: tuple[FrictionBand, ...], mean: BandMean) -> None:
    table(
        "Friction band: c on unloading against c on loading",
        ["session", "posture", "masses [g]", "loading", "unloading", "tapped", "mean", "half difference", "sd"],
        [
            [
                b.session, b.posture, _masses(b.masses_g), b.loading, b.unloading, b.tapped, b.mean,
                f"{b.half_difference:+.4f}",
                None if b.half_difference_sd is None else f"{b.half_difference_sd:.4f}",
            ]
            for b in bands
        ],
        "sd: standard uncertainty of the half difference, from the readings alone",
    )  # fmt: skip
    within = "" if mean.low is None else f" (95 %: {mean.low:+.4f} to {mean.high:+.4f})"
    say(f"Mean of both directions {mean.mean:.4f}, half difference {mean.half_difference:+.4f}{within}, n = {mean.n}.")


def _masses(masses_g: dict[str, float]) -> str:
    return " ".join(f"{tendon} {mass:g}" for tendon, mass in masses_g.items())
