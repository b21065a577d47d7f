"""Check of a stored session, and its report as one page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import orjson

from daq.checks import check
from daq.errors import InputError
from daq.findings import finding
from fingermodel.comparing import compare
from fingermodel.session import Session
from server.application.checking import model_findings
from server.application.diagnosis_report import diagnosis_sections, subtitle
from server.application.drawing import comparison_notes
from server.application.provenance import origin_of, provenance, told_first
from server.figures.compared import Compared
from server.figures.comparison import comparison_sections, report_title
from server.figures.effect_on_finger import effect_on_finger
from server.figures.plot import Plot
from server.figures.report import Section, report_body, report_header, report_html
from server.figures.report_front import closing_sections, folded, read_first
from server.figures.style import NothingToDrawError
from server.service.exports.session_folders import session_folder
from server.service.figures.comparison import Only, drawn_comparison
from server.service.figures.diagnosed import diagnosed
from server.service.figures.parts import resolved, spread_members, spread_of
from server.service.services import Services
from server.service.sessions.blinding import require_closed, seen
from server.service.sessions.measuring import Measured
from server.service.sessions.records import changed_since
from server.service.web.problems import ProblemError

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from daq.findings import Finding
    from daq.sessions.models import Session as BenchSession
    from fingermodel.comparison.comparison import Comparison
    from server.figures.arrows import Spread

T = TypeVar("T")

# As the pages say it, beside the report that they show.
OUTDATED = "The session was changed since this search: search again."


def checked(parts: Services, session: str) -> dict[str, Any]:
    """Return what `fingertwin check` says of a session: of its description, recording, windows, weights and finger.

    Raises:
        InputError: the session has no load case, or no readings for its windows.
        ProblemError: there is no such session.
    """
    measured = parts.measuring.of(session)
    return _once(parts, measured, ("check",), lambda: _checked(parts, measured))


def _once(parts: Services, measured: Measured, key: tuple[Any, ...], make: Callable[[], T]) -> T:
    """Make something of a session; keep it where the session is closed."""
    if not measured.record.closed:
        return make()
    made: T = parts.made.of((measured.key, *key), make)
    return made


def _checked(parts: Services, measured: Measured) -> dict[str, Any]:
    with session_folder(parts, measured) as (_, kept):
        report = check(kept)
        if report.ok:
            found = _model_findings(parts, measured, kept)
            report = replace(report, findings=(*found, *report.findings))
    return {"schema": "fingertwin/check/1"} | {k: v for k, v in report.as_dict().items() if k != "schema"}


def _model_findings(parts: Services, measured: Measured, kept: BenchSession) -> Sequence[Finding]:
    try:
        # A finger that is a file of the bench is not looked for here.
        parts.models.model(None, measured)
    except (ProblemError, InputError) as error:
        return [finding("error", "not_predictable", "session", error.found, error.expected, error.remedy)]
    return model_findings(kept)


@dataclass(frozen=True)
class Report:
    """The report of a session, to be written as a page or shown in one; `outdated` where its search is."""

    title: str
    subtitle: str
    sections: list[Section]
    outdated: bool = False


def report_of(parts: Services, session: str, model: str | None, job: str | None) -> Report:
    """Return the report of a session: what a search found on the first page, then the comparison and all details.

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
    measured = parts.measuring.of(session)
    found: list[Section] = []
    answer: dict[str, Any] = {}
    history: Sequence[Mapping[str, Any]] | None = None
    if job is not None:
        require_closed(measured)
        _, answer, history = diagnosed(parts, job, session)
        model = str(answer.get("model")) if model is None else model
    named = resolved(parts, measured, model)
    bench = parts.models.bench(measured, named)
    history = list(bench.loaded.history) or history
    comparison = seen(measured, compare(bench))
    spread = spread_of(parts, spread_members(parts, measured), comparison)
    # As the session stands, also where the search is older: that is said beside it.
    stands = {k: v for k, v in provenance(bench).items() if k in ("warnings", "amendments")}
    stands |= {"excluded": measured.excluded}
    if job is not None:
        now = answer | stands | {"held": list(bench.loaded.added)}
        found = diagnosis_sections(now, history, _finger(parts, measured, job, answer))
    notes = comparison_notes(bench)
    if len(comparison.cases) < len(bench.measured.cases):
        notes.append("Validation cases are left out until the session is closed.")
    compared = comparison_sections(Compared.of(bench, comparison, spread=spread), notes)
    if measured.record.closed:
        compared[1:1] = folded(_beside(parts, measured, bench, comparison, spread))
    readings = parts.models.provenance(measured, bench, digest=True)["readings"]
    origin = origin_of(bench, None if readings is None else readings["sha256_of_chunks"])
    closing = closing_sections(origin)
    if job is None:
        first = read_first(told_first(stands))
        return Report(report_title(session), f"Model: {bench.loaded.name}", [*first, *compared, *closing])
    below = subtitle(answer | {"origin": origin})
    outdated = changed_since(measured.record.edits, parts.jobs.get(job).started_utc or "")
    return Report(f"Report of {session}", below, [*found, *folded(compared), *closing], outdated)


def report_page(parts: Services, session: str, model: str | None, job: str | None) -> str:
    """Return the report as a page that stands alone; arguments and errors as of `report_of`."""
    return _report(parts, session, model, job, _page)


def report_sheet(parts: Services, session: str, model: str | None, job: str | None) -> dict[str, Any]:
    """Return the report for the pages, its figures apart; arguments and errors as of `report_of`."""
    return {"schema": "fingertwin/report/1", "session": session} | _report(parts, session, model, job, _sheet)


def _page(report: Report) -> str:
    first, *rest = report.sections
    # The pages say it beside the report; one that was saved has to say it itself.
    outdated = [OUTDATED] if report.outdated else []
    return report_html([replace(first, parts=[*outdated, *first.parts]), *rest], report.title, report.subtitle)


def _sheet(report: Report) -> dict[str, Any]:
    body, figures = report_body(report.sections)
    drawn = [orjson.loads(figure.to_json()) for figure in figures]
    html = report_header(report.title, report.subtitle, alone=False) + body
    return {"html": html, "figures": [{"data": figure["data"], "layout": figure["layout"]} for figure in drawn]}


def _report(parts: Services, session: str, model: str | None, job: str | None, form: Callable[[Report], T]) -> T:
    """Return a report in a form, from the session and the spread of the specimen's other sessions."""
    measured = parts.measuring.of(session)
    named = resolved(parts, measured, model)
    others = tuple(other.key for other in spread_members(parts, measured))
    return _once(parts, measured, (form, named, job, others), lambda: form(report_of(parts, session, model, job)))


def _finger(parts: Services, measured: Measured, job: str, answer: Mapping[str, Any]) -> go.Figure | None:
    """Return the finger with what the verdict would add; None where that is nothing, or the answer has no fit of it."""
    added = (answer.get("where_after") or {}).get("added")
    if not added:
        return None
    with suppress(NothingToDrawError, ProblemError):
        return effect_on_finger(parts.models.bench(measured, f"{job}/{'+'.join(added)}"), added)
    return None


def _beside(
    parts: Services, measured: Measured, bench: Session, comparison: Comparison, spread: Mapping[str, Spread] | None
) -> list[Section]:
    """Return the predictions of a revision on the finger beside those of what it was made from."""
    if not bench.loaded.history:
        return []
    with suppress(NothingToDrawError, ProblemError):
        parent = str(parts.revisions.read(bench.loaded.name)["parent"])
        known = parent in parts.sessions.fingers or parent in [h["id"] for h in bench.loaded.history[1:]]
        other = parts.models.bench(measured, parent if known else None)
        before = (other.loaded.name, other, compare(other))
        figure, caption = drawn_comparison("vectors", bench, comparison, Only(), before, spread)
        return [Section("Before and after, on the finger", [Plot("vectors", "", figure, caption)])]
    return []
