"""`fingertwin compare` and `fingertwin refit`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.amendments import listed
from daq.errors import InputError
from server.commands.amend import amended_line
from server.console import answer, columns_wide, progress, say, table
from server.drawing import draw_comparison
from server.workflow import Bench, compare_bench, open_bench, refit_bench, save_revision

if TYPE_CHECKING:
    from fingermodel.compare import Comparison
    from fingermodel.fit_report import Fit, FittedParameter


def compare_session(
    session: str, model: str | None, effects: list[str], figures: Path | None, json: str | None
) -> None:
    """Compare a session with a model and show it."""
    with progress("Reading and correcting") as tell:
        bench = open_bench(session, model, tell, effects=effects)
    comparison = compare_bench(bench)
    body = provenance(bench) | comparison.as_dict()
    page = draw_comparison(bench, comparison, figures) if figures else None
    if page:
        body["figures"] = str(page)
    if answer("compare", body, json):
        return
    say_first(body)
    print_comparison(bench, comparison)
    if page:
        say(f"Figures: {page}")


def refit_session(
    session: str,
    method: str,
    model: str | None,
    out: Path | None,
    plane: str | None,
    effects: list[str],
    figures: Path | None,
    json: str | None,
) -> None:
    """Refit a model to a session, write the revision and show what changed."""
    from fingermodel.model_files import free_path, require_new

    if method == "slsqp" and plane is not None:
        raise InputError(f"--plane {plane} with --method slsqp", "no --plane", "Eq 5 is posed in the sagittal plane")
    if out is not None:
        require_new(out)
    with progress("Reading and correcting") as tell:
        bench = open_bench(session, model, tell, effects=effects)
    with progress("Refitting"):
        before, fit, after = refit_compared(bench, method, plane)
    path = out or free_path(Path("models"), bench.measured.session.id)
    save_revision(bench, fit, path, before.summary(), after.summary())
    page = None
    if figures:
        page = draw_comparison(bench, after, figures, before=before, theta=fit.theta, model_name="refitted")
    body = provenance(bench) | fit_body(fit, before, after) | {"model": str(path)}
    if answer("refit", body, json):
        return
    say_first(body)
    print_fit(fit, before, after)
    say(f"Model: {path}   (fingertwin compare {session} --model {path})")
    if page:
        say(f"Figures: {page}")


def refit_compared(bench: Bench, method: str = "map", plane: str | None = None) -> tuple[Comparison, Fit, Comparison]:
    """Refit a bench's model, with the comparison before and after."""
    from fingermodel.compare import compare

    before = compare_bench(bench)
    fit = refit_bench(bench, method, plane)
    return before, fit, compare(bench.model, bench.observations, fit.theta)


def provenance(bench: Bench) -> dict[str, Any]:
    """Say which session, model and corrections an answer came from."""
    measured = bench.measured
    return {
        "session": measured.session.id,
        "model": bench.loaded.name,
        "tension_factor": measured.tension_factor,
        "tension_factor_source": measured.tension_factor_source,
        "budget": bench.model.budget.name,
        "judged_in": bench.model.finger.judged_in,
        "notes": [*measured.notes, *bench.loaded.notes],
        "warnings": [f.as_warning() for f in bench.findings],
        "amendments": listed(measured.session),
    }


def say_first(body: Mapping[str, Any]) -> None:
    """Print what has to be known before a result: warnings of the check, and what was amended."""
    for warning in body["warnings"]:
        say(f"Warning: {warning['place']}: {warning['words']}")
    for row in body["amendments"]:
        say(amended_line(row))


def fit_body(fit: Fit, before: Comparison, after: Comparison) -> dict[str, Any]:
    """Return the contract's refit answer, without the model's path."""
    return {
        "method": fit.method,
        "outcome": fit.outcome,
        "message": fit.message,
        "objective": fit.objective,
        "objective_before": fit.objective_before,
        "residuals": fit.residuals,
        "evaluations": fit.evaluations,
        "seconds": fit.seconds,
        "before": before.summary(),
        "after": after.summary(),
        "parameters": [asdict(p) for p in fit.parameters],
        "optima": [{"objective": objective, "probability": share} for objective, share in fit.optima],
        "correlated": [{"a": a, "b": b, "r": r} for a, b, r in fit.correlated],
    }


def print_comparison(bench: Bench, comparison: Comparison) -> None:
    """Print the cases and the summaries."""
    session = bench.measured.session
    table(
        f"{session.id} against {bench.loaded.name}: force on the cell [N], x proximal, y dorsal, z radial",
        *_case_table(comparison, columns_wide()),
        "z: residual in standard uncertainties of the reading"
        + (" (assumed from the budget, none is stated)" if comparison.noise_assumed else ""),
    )
    print_summary(comparison)
    for note in provenance(bench)["notes"]:
        say(f"Note: {note}")
    if bench.model.finger.judged_in == "sagittal":
        say(
            "Note: judge this finger in the sagittal plane; the clamp carries Tx and Ty too, so four joint torques do "
            "not determine Fz."
        )


def _case_table(comparison: Comparison, width: int) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows of the load cases, with as much as fits: vectors, fewer of them, or magnitudes alone."""
    rows: list[list[Any]] = []
    if width < 120:
        for c in comparison.cases:
            sizes = [float(np.linalg.norm(v)) for v in (c.measured_N, c.predicted_N, c.measured_N - c.predicted_N)]
            rows.append([c.id, c.location, *sizes, c.z])
        return ["case", "at", "|measured|", "|predicted|", "|residual|", "z"], rows
    for c in comparison.cases:
        masses = " ".join(f"{m} {mass:g}" for m, mass in c.masses_g.items())
        vectors = [_triple(c.measured_N), _triple(c.predicted_N)]
        if width < 160:
            rows.append([c.id, c.location, masses, *vectors, c.z])
        else:
            rest = _triple(c.measured_N - c.predicted_N)
            rows.append([c.id, c.role[:5], c.posture, c.location, masses, *vectors, rest, c.z])
    if width < 160:
        return ["case", "at", "masses [g]", "measured", "predicted", "z"], rows
    return ["case", "role", "posture", "at", "masses [g]", "measured", "predicted", "residual", "z"], rows


def print_summary(comparison: Comparison) -> None:
    """Print error summaries by role and location, then by muscle and by posture."""
    columns = ["", "plane", "cases", "RMSE [N]", "RMSE [%]", "size [N]", "size [%]", "direction [deg]", "of"]
    rows = []
    for what, groups in (
        ("", comparison.summary()),
        ("muscle ", comparison.by("muscles")),
        ("posture ", comparison.by("posture")),
    ):
        for name, planes in groups.items():
            for plane in ("sagittal", "space"):
                e = planes[plane]
                numbers = ["rmse_N", "rmse_rel_pct", "magnitude_error_N", "magnitude_error_pct", "direction_error_deg"]
                numbers.append("direction_cases")
                rows.append([what + name, plane, e["cases"], *(e[k] for k in numbers)])
    table(
        "Errors",
        columns,
        rows,
        "size: of the force's magnitude; direction: over the cases (of) that stand out from their uncertainty",
    )
    moments = comparison.moments()
    if moments:
        table(
            "Tip moment about z",
            ["", "cases", "RMSE [N mm]", "mean measured [N mm]"],
            [[k, m["cases"], m["rmse_Mz_Nmm"], m["mean_abs_Mz_Nmm"]] for k, m in moments.items()],
        )


def print_fit(fit: Fit, before: Comparison, after: Comparison) -> None:
    """Print what moved most, and errors before and after."""
    moved = sorted(
        (p for p in fit.parameters if p.prior_sd),
        key=lambda p: -p.moved,
    )
    flat = [p for p in fit.parameters if not p.prior_sd]
    rows = [[p.name, p.unit, p.initial, p.value, p.sd, p.prior_sd, _remark(p)] for p in [*flat, *moved[:12]]]
    table(
        f"{len(fit.parameters)} parameters fitted to {fit.residuals} readings by {fit.method}; what moved most",
        ["parameter", "unit", "before", "value", "sd", "prior sd", ""],
        rows,
    )
    columns = [
        "",
        "plane",
        "RMSE [N] before",
        "after",
        "direction [deg] before",
        "after",
        "magnitude [%] before",
        "after",
    ]
    lines = []
    old, new = before.summary(), after.summary()
    for name, planes in new.items():
        for plane, e in planes.items():
            b = old[name][plane]
            cells = [b["rmse_N"], e["rmse_N"], b["direction_error_deg"], e["direction_error_deg"]]
            lines.append([name, plane, *cells, b["magnitude_error_pct"], e["magnitude_error_pct"]])
    table("Errors before and after (validation cases were not fitted)", columns, lines)
    say(fit.message)
    change = f"{fit.objective_before:.4g} -> {fit.objective:.4g}"
    say(f"Objective {change} in {fit.evaluations} evaluations, {fit.seconds:.2f} s")


def _remark(p: FittedParameter) -> str:
    if p.at_bound:
        return "at bound"
    if not p.identified:
        return "prior only"
    return f"{p.moved:.1f} prior sd away" if p.moved > 2.0 else ""


def _triple(v: Any) -> str:
    return " ".join(f"{x:7.3f}" for x in v)
