"""`fingertwin compare` and `fingertwin refit`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.files import require_writable
from daq.quoting import quoted
from fingermodel.comparing import compare
from fingermodel.fitting.fit_report import CORRELATED, Fit, FittedParameter
from fingermodel.model_files import free_path, require_new
from fingermodel.revisions import save_revision
from fingermodel.session import Session
from server.application.drawing import draw_comparison
from server.application.fitted_mounts import tells_of_mounting
from server.application.provenance import provenance, told_first
from server.application.refitting import fit_body, refit_compared
from server.commands.console import answer, progress, say, shown, table

if TYPE_CHECKING:
    from fingermodel.comparison.comparison import CaseComparison, Comparison

_OF_MOUNTINGS = (
    "mount_offset: from the load point to the cell's origin; a session's offset_mm is the opposite. Rotations: of the "
    "reading; a session's rotation_deg turns it back."
)
# Of the correlations, as many as are printed.
_MOST_PAIRS = 12
# So many prior sd from its prior, a parameter is unusual.
_FAR = 2.0


def compare_session(
    session: str, model: str | None, effects: list[str], figures: Path | None, json: str | None
) -> None:
    """Compare a session with a model and show it."""
    with progress("Reading and correcting") as tell:
        bench = Session.open(session, model, progress=tell, effects=effects, catalogue=False)
    comparison = compare(bench)
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
    if method == "slsqp" and plane is not None:
        raise InputError(f"--plane {plane} with --method slsqp", "no --plane", "Eq 5 is posed in the sagittal plane")
    if out is not None:
        require_new(out)
    require_writable(out or Path("models"), folder=out is None)
    with progress("Reading and correcting") as tell:
        bench = Session.open(session, model, progress=tell, effects=effects, catalogue=method == "map")
    with progress("Refitting") as tell:
        before, fit, after = refit_compared(bench, method, plane, tell)
    path = out or free_path(Path("models"), bench.measured.session.id)
    save_revision(bench, fit, path, before.summary(), after.summary())
    page = None
    if figures:
        page = draw_comparison(bench, after, figures, before=before, theta=fit.theta, model_name="refitted")
    body = provenance(bench) | fit_body(bench, fit, before, after) | {"model": str(path)}
    if answer("refit", body, json):
        return
    say_first(body)
    print_fall(before, after, without=fit.errors.not_counted)
    say(f"Model: {path}   (fingertwin compare {quoted(session)} --model {quoted(path)})")
    print_fit(fit, body["mounts"])
    if page:
        say(f"Figures: {page}")


def say_first(body: Mapping[str, Any]) -> None:
    """Print what has to be known before a result."""
    for line in told_first(body):
        say(line)


def print_comparison(bench: Session, comparison: Comparison) -> None:
    """Print the errors, then case by case, then by muscle and posture."""
    name = f"{bench.measured.session.id} against {bench.loaded.name}"
    table(f"{name}: errors of the predicted force", *_errors(comparison.summary()), _OF_ERRORS)
    moments = comparison.moments()
    if moments:
        table(
            "Tip moment about z",
            ["cases", "n", "RMSE [N mm]", "mean measured [N mm]"],
            [[_words(k), m["cases"], m["rmse_Mz_Nmm"], m["mean_abs_Mz_Nmm"]] for k, m in moments.items()],
        )
    for note in provenance(bench)["notes"]:
        say(f"Note: {note}")
    if bench.model.finger.judged_in == "sagittal":
        say(
            "Note: judge this finger in the sagittal plane; the clamp carries Tx and Ty too, so four joint torques do "
            "not determine Fz."
        )
    table(
        f"{name}: force on the cell [N], x proximal, y dorsal, z radial",
        ["case", "load [g], posture, cell at, role", "measured", "predicted", "residual", "z"],
        [
            [c.id, _load(c), *map(_triple, (c.measured_N, c.predicted_N, c.measured_N - c.predicted_N)), c.z]
            for c in comparison.cases
        ],
        "z: residual in standard uncertainties of the reading"
        + (" (assumed from the budget, none is stated)" if comparison.noise_assumed else ""),
    )
    for what, key in (("tendons loaded", "muscles"), ("posture", "posture")):
        table(f"Errors by {what}", *_errors(comparison.by(key)))


def _load(case: CaseComparison) -> str:
    masses = " ".join(f"{m} {mass:g}" for m, mass in case.masses_g.items())
    return f"{masses}, {case.posture}, {case.location}, {case.role}"


_OF_ERRORS = "magnitude: of the force; direction: over the cases (of) that stand out from their uncertainty"


def _errors(groups: Mapping[str, Any]) -> tuple[list[str], list[list[Any]]]:
    """Return columns and rows of error summaries, in the sagittal plane and in space."""
    columns = ["cases", "plane", "n", "RMSE [N]", "RMSE [%]", "magnitude [N]", "[%]", "direction [deg]", "of"]
    keys = ("cases", "rmse_N", "rmse_rel_pct", "magnitude_error_N", "magnitude_error_pct", "direction_error_deg")
    return columns, [
        [_words(name), plane, *(planes[plane][key] for key in (*keys, "direction_cases"))]
        for name, planes in groups.items()
        for plane in ("sagittal", "space")
    ]


def print_fall(*comparisons: Comparison | None, without: Sequence[str] = ()) -> None:
    """Print the errors before, refitted alone where something was added, and after; and which cases do not count."""
    summaries, shown_ids = [c.summary() for c in comparisons if c is not None], ", ".join(without)
    steps = "before → refitted alone → with what was added" if len(summaries) > 2 else "before → after"
    keys = ("rmse_N", "direction_error_deg", "magnitude_error_pct")
    table(
        f"Errors {steps} (validation cases were not fitted{f'; without {shown_ids}' if shown_ids else ''})",
        ["cases", "plane", "RMSE [N]", "direction [deg]", "magnitude [%]"],
        [
            [_words(name), plane, *(" → ".join(shown(s[name][plane][key]) for s in summaries) for key in keys)]
            for name, planes in summaries[-1].items()
            for plane in planes
        ],
    )


def print_fit(fit: Fit, mounts: Mapping[str, Mapping[str, Any]]) -> None:
    """Print how the fit went, what moved most with value, sd and prior, and which parameters move together.

    Args:
        fit: to print.
        mounts: that would take it up, by location, as the session describes them.
    """
    say(fit.message)
    fall = f"{fit.objective_before:.4g} → {fit.objective:.4g}"
    say(f"Objective {fall}, {fit.evaluations} evaluations, {fit.seconds:.2f} s")
    flat = [p for p in fit.parameters if not p.prior_sd]
    moved = sorted((p for p in fit.parameters if p.prior_sd and not p.at_bound), key=lambda p: -p.moved)
    bound = [p for p in fit.parameters if p.prior_sd and p.at_bound]
    listed = [*flat, *bound, *moved[:12]]
    table(
        f"{len(fit.parameters)} parameters fitted to {fit.residuals} readings by {fit.method}; what moved most",
        ["parameter", "unit", "value", "sd", "prior", "prior sd", ""],
        [[p.name, p.unit, p.value, p.sd, p.initial, p.prior_sd, _remark(p)] for p in listed],
        _OF_MOUNTINGS if any(tells_of_mounting(p.name) for p in listed) else "",
    )
    _say_mounts(fit, mounts)
    if fit.correlated:
        table(
            f"Correlations above {CORRELATED:g}",
            ["parameter", "with", "r"],
            [[a, b, r] for a, b, r in fit.correlated[:_MOST_PAIRS]],
            f"{len(fit.correlated)} pairs; --json lists all" if len(fit.correlated) > _MOST_PAIRS else "",
        )


def _say_mounts(fit: Fit, mounts: Mapping[str, Mapping[str, Any]]) -> None:
    """Print how a mounting that is far off, or that an effect turns, is entered in the session."""
    telling = [p for p in fit.parameters if tells_of_mounting(p.name) and (p.moved > _FAR or p.kind == "effect")]
    for location, mount in mounts.items():
        here = [p.name for p in telling if p.name.split(".")[1].startswith((location, "common"))]
        moved = [name for name in here if name.startswith("mount_offset")]
        if moved or (here and "rotation_deg" in mount):
            entry = ", ".join(f"{key}: {_as_entry(value)}" for key, value in mount.items())
            say(f"Where the rig confirms it, put into load_cell.mounts of session.yaml:  {location}: {{{entry}}}")
        if len(here) > len(moved) and "rotation_deg" not in mount:
            say(
                f"session.yaml cannot turn the {location} readings of a left hand that state no rotation. Give them in "
                "the cell's axes, with its rotation."
            )


def _as_entry(value: Any) -> str:
    """Return a value of a mount as `session.yaml` has it, numbers to a hundredth."""
    return value if isinstance(value, str) else f"[{', '.join(f'{x:.2f}' for x in value)}]"


def _remark(p: FittedParameter) -> str:
    if p.at_bound:
        return "at bound"
    if not p.identified:
        return "prior only"
    return f"{p.moved:.1f} prior sd away" if p.moved > _FAR else ""


def _words(group: str) -> str:
    """Return a group of cases as it is read: `validation/tip` in two words."""
    return group.replace("/", " ")


def _triple(v: Any) -> str:
    return " ".join(f"{x:7.3f}" for x in v)
