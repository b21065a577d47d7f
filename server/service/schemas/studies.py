"""Forms of published studies."""

from __future__ import annotations

from pydantic import Field

from server.service.schemas.common import Answered, Form, Shown


class StudyShown(Shown):
    """A published study, and the last time that it was computed here."""

    name: str
    citation: str
    about: str
    job: str | None = Field(description="That computed it last; null where none did.")
    state: str | None = Field(description="Of that job.")


class StudyList(Answered):
    """The published studies that can be computed."""

    studies: list[StudyShown]


class StudyRow(Shown):
    """A published figure beside ours."""

    quantity: str
    published: float | None = Field(description="In `unit`; null where a range was published.")
    ours: float | None = Field(description="In `unit`; null where it cannot be had.")
    unit: str
    agrees: bool | None = Field(description="Null where a comparison would mean nothing; `note` says why.")
    note: str
    printed: str = Field(description="The number, or range, with its printed digits.")


class StudySheet(Shown):
    """A table beside the published figures."""

    title: str
    columns: list[str]
    lines: list[list[str | float | None]]
    notes: list[str]


class StudyFigure(Shown):
    """A figure that can be asked for at `/figures/study/{study}/{name}`."""

    name: str
    heading: str


class StudyComputed(StudyShown, Answered):
    """A study with every published figure beside ours."""

    rows: list[StudyRow]
    assumptions: list[str] = Field(description="What the paper leaves out and what stands in its place.")
    sheets: list[StudySheet]
    figures: list[StudyFigure]
    version: str | None = Field(description="Of the software that computed it; null where it was not computed yet.")


class AskedReproduction(Form):
    """Nothing has to be said."""

    timeout_s: float | None = Field(default=None, gt=0.0, le=86_400.0, description="After which it is given up [s].")
