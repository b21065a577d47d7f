"""Sessions and revisions as files for other software; what is found in a session; its report as one page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field

from server.service.answers import JsonAnswer
from server.service.exports.exporting import RevisionFormat, SessionFormat, revision_export, session_export
from server.service.exports.reports import checked, report_page, report_sheet
from server.service.schemas.common import ModelName, RevisionId, SessionId, Shown, documented
from server.service.schemas.figures import PlotlyFigure
from server.service.services import of
from server.service.web.downloads import FileAnswer, attachment, download
from server.service.web.examples import EXAMPLES
from server.service.web.strict_requests import ReadingRoute
from server.service.web.workers import run

router = APIRouter(route_class=ReadingRoute, tags=["exports"])

# Media types by format.
MEDIA: Mapping[str, str] = {
    "csv": "text/csv",
    "columns": "application/json",
    "parquet": "application/vnd.apache.parquet",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "hdf5": "application/x-hdf5",
    "c3d": "application/octet-stream",
    "mat": "application/x-matlab-data",
    "supplement": "application/zip",
    "folder": "application/zip",
    "json": "application/json",
    "osim": "application/xml",
    "mjcf": "application/xml",
    "finger": "application/yaml",
    "html": "text/html",
    "jsonl": "application/jsonl",
}
OfSession = Annotated[
    SessionFormat,
    Query(
        alias="format",
        description="csv, parquet, xlsx: measured and predicted force of every load case; columns: unit, frame and "
        "meaning of the csv's columns, and what it came from (JSON); hdf5, mat: cases and readings; c3d: the six "
        "channels; supplement: one archive for a paper, without private names; folder: the session as the command line "
        "has it.",
    ),
]
OfRevision = Annotated[
    RevisionFormat,
    Query(
        alias="format",
        description="json: the document; csv, parquet, xlsx: its parameters; columns: of the csv; osim, mjcf: its "
        "finger without its effects, for OpenSim or MuJoCo.",
    ),
]
Job = Annotated[str | None, Query(max_length=200, description="A diagnosis of the session that is done.")]
# The page's own script may run; it can reach nothing, neither the network nor the service.
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class FindingShown(Shown):
    """Something that was found."""

    level: str = Field(description="error, warning or note.")
    code: str
    where: str
    text: str


class ReportSheet(Shown):
    """A report to be shown in a page."""

    schema_: str = Field(alias="schema", examples=["fingertwin/report/1"])
    session: str
    html: str = Field(description="Of its sections; every text that came from outside is escaped.")
    figures: list[PlotlyFigure]


class Checked(Shown):
    """Findings in a session."""

    schema_: str = Field(alias="schema", examples=["fingertwin/check/1"])
    session: str
    ok: bool = Field(description="Whether it can be used.")
    findings: list[FindingShown]


def files(formats: Iterable[str], description: str) -> dict[int | str, dict[str, Any]]:
    """Return the documentation of an answer that is a file.

    Args:
        formats: of MEDIA.
        description: of the file.
    """
    binary, plain = {"type": "string", "format": "binary"}, {"type": "object"}
    # What such a client reads of them is an object and no text.
    read = ("application/json", "application/yaml")
    content: dict[str, Any] = {k: {"schema": plain if k in read else binary} for k in (MEDIA[f] for f in formats)}
    if read[0] in content:
        content[read[0]]["example"] = EXAMPLES["Columns"]
    disposition = {"description": "attachment, with a file name", "schema": {"type": "string"}}
    answer = {"description": description, "content": content, "headers": {"Content-Disposition": disposition}}
    return {**{k: v for k, v in documented(Shown).items() if k != 200}, 200: answer}


@router.get(
    "/sessions/{session}/export",
    response_class=Response,
    responses=files(get_args(SessionFormat), "The file."),
)
async def export_session(
    session: SessionId, request: Request, file_format: OfSession, model: ModelName = None
) -> FileAnswer:
    """Write a session for other software, as `fingertwin export` does.

    While a bench is running, validation cases have no prediction in any format.
    """
    write = await run("readers", session_export, of(request), session, file_format, model)
    headers = {"Link": '<?format=columns>; rel="describedby"'} if file_format == "csv" else None
    return await download(write, MEDIA[file_format], headers)


@router.get(
    "/revisions/{revision}/export",
    response_class=Response,
    responses=files(get_args(RevisionFormat), "The file."),
)
async def export_revision(revision: RevisionId, request: Request, file_format: OfRevision = "json") -> FileAnswer:
    """Write a revision's document, its parameters as a table, or its finger."""
    write = await run("readers", revision_export, of(request), revision, file_format)
    return await download(write, MEDIA[file_format])


@router.get("/sessions/{session}/check", responses=documented(Checked))
async def check(session: SessionId, request: Request) -> JsonAnswer:
    """Look for everything that is wrong with a session, as `fingertwin check` does: recording, windows, tares, weights.

    The stored readings are read once more from the beginning, which takes some seconds for a long recording.
    """
    return JsonAnswer(await run("apart", lambda: checked(of(request), session)))


@router.get(
    "/sessions/{session}/report",
    response_class=Response,
    responses=files(["html"], "A page that loads nothing from anywhere."),
)
async def report(session: SessionId, request: Request, model: ModelName = None, job: Job = None) -> Response:
    """Return the report of a session as one page to be saved: the comparison, and a diagnosis where a job is named.

    It is an attachment: opened from where it was saved, it runs in no origin of the service. While a bench is running,
    validation cases are left out.
    """
    page = await run("apart", lambda: report_page(of(request), session, model, job))
    headers = {"Content-Disposition": attachment(f"{session}-report.html"), "Content-Security-Policy": REPORT_POLICY}
    return Response(page, 200, headers, "text/html")


@router.get("/sessions/{session}/report/sheet", responses=documented(ReportSheet))
async def sheet(session: SessionId, request: Request, model: ModelName = None, job: Job = None) -> JsonAnswer:
    """Return the same report to be shown in a page: its text as HTML, and the figures for its places plot0 and on."""
    return JsonAnswer(await run("apart", lambda: report_sheet(of(request), session, model, job)))
