"""What is found in a session as it is stored, and its report as one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from daq.checks import check
from daq.errors import InputError
from daq.findings import finding
from server.service.blinding import require_closed, seen
from server.service.figure_parts import resolved, spread_members, spread_of
from server.service.figures import diagnosed
from server.service.measuring import Measured
from server.service.problems import ProblemError
from server.service.services import Services
from server.service.session_folders import session_folder
from server.workflow import compare_bench

if TYPE_CHECKING:
    from daq.findings import Finding
    from server.figures.report import Section


def checked(parts: Services, session: str) -> dict[str, Any]:
    """Return what `fingertwin check` says of a session: of its description, recording, windows, weights and finger.

    Raises:
        InputError: the session has no load case, or no readings for its windows.
        ProblemError: there is no such session.
    """
    measured = parts.measuring.of(session)
    with session_folder(parts, measured) as (folder, _):
        report = check(folder)
        if report.ok:
            found = _model_findings(parts, measured, str(folder))
            report = replace(report, findings=(*found, *report.findings))
    return {"schema": "fingertwin/check/1"} | {k: v for k, v in report.as_dict().items() if k != "schema"}


def _model_findings(parts: Services, measured: Measured, folder: str) -> Sequence[Finding]:
    from server.commands.bench import model_findings

    try:
        # A finger that is a file of the bench is not looked for here.
        parts.twins.model(None, measured)
    except ProblemError as error:
        body = error.body
        return [finding("error", "not_predictable", "session", body["found"], body["expected"], body["remedy"])]
    except InputError as error:
        return [finding("error", "not_predictable", "session", error.found, error.expected, error.remedy)]
    return model_findings(folder)


def report_page(parts: Services, session: str, model: str | None, job: str | None) -> str:
    """Return the page of a comparison as `fingertwin compare --figures` makes it, with a diagnosis after it.

    While a bench is running, validation cases are left out.

    Args:
        parts: of the service.
        session: its id.
        model: that it is compared with; of a diagnosis by default the model that was diagnosed.
        job: of a diagnosis of the session that is done; None for none.

    Raises:
        InputError: the session or the model cannot be used.
        ProblemError: there is no such session, model or job; 409 the session is still running, or the job.
    """
    from server.diagnosis_report import STYLE
    from server.drawing import comparison_notes
    from server.figures.comparison import comparison_sections, report_title
    from server.figures.report import report_html

    measured = parts.measuring.of(session)
    after: list[Section] = []
    if job is not None:
        require_closed(measured)
        answer, after = _diagnosis(parts, session, job)
        model = str(answer.get("model")) if model is None else model
    named = resolved(parts, measured, model)
    bench = parts.twins.bench(measured, named)
    comparison = seen(measured, compare_bench(bench))
    notes = comparison_notes(bench)
    if len(comparison.cases) < len(bench.measured.cases):
        notes.append("Validation cases are left out until the session is closed.")
    sections, _ = comparison_sections(
        bench.model,
        bench.observations,
        comparison,
        None,
        bench.loaded.name,
        spread_of(parts, spread_members(parts, measured), comparison),
        theta=bench.theta,
        model_name=bench.loaded.name,
        notes=notes,
    )
    page = report_html([*sections, *after], report_title(bench.measured.session.id), f"Model: {bench.loaded.name}")
    return page.replace("</style>", f"{STYLE}</style>", 1) if after else page


def _diagnosis(parts: Services, session: str, job: str) -> tuple[dict[str, Any], list[Section]]:
    from server.diagnosis_report import diagnosis_sections

    _, answer, history = diagnosed(parts, job, session)
    return answer, diagnosis_sections(answer, history, {})
