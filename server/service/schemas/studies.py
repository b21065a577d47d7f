"""Forms of published studies."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, Field

from server.service.schemas.common import Form, Shown

STUDY: dict[str, Any] = {
    "name": "synek2019",
    "citation": "Synek et al. 2019, PeerJ 7:e7470",
    "about": "tip and bone forces of clamped cadaver fingers",
    "job": "0d9cf8a1c02f4b5c9e0a3f0c6a1f7be2",
    "state": "done",
}
_ROW: dict[str, Any] = {
    "quantity": "friction factor c (Eq 1)",
    "published": 0.835,
    "ours": 0.8348,
    "unit": "1",
    "agrees": True,
    "note": "",
    "printed": "0.835",
}
_COMPUTED: dict[str, Any] = {
    "rows": [_ROW],
    "assumptions": ["The tip load acts at mid pulp."],
    "sheets": [],
    "figures": [{"name": "scatter", "heading": "Force components"}],
    "version": "0.1.0",
}


class StudyShown(Shown):
    """A published study, and the last time that it was computed here."""

    model_config = ConfigDict(json_schema_extra={"example": STUDY})

    name: str
    citation: str
    about: str
    job: str | None = Field(description="That computed it last; null where none did.")
    state: str | None = Field(description="Of that job.")


class StudyList(Shown):
    """The published studies that can be computed."""

    studies: list[StudyShown]


class StudyRow(Shown):
    """A published figure beside ours."""

    model_config = ConfigDict(json_schema_extra={"example": _ROW})

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


class StudyComputed(StudyShown):
    """A study with every published figure beside ours."""

    model_config = ConfigDict(json_schema_extra={"example": STUDY | _COMPUTED})

    rows: list[StudyRow]
    assumptions: list[str] = Field(description="What the paper leaves out and what stands in its place.")
    sheets: list[StudySheet]
    figures: list[StudyFigure]
    version: str | None = Field(description="Of the software that computed it; null where it was not computed yet.")


class AskedReproduction(Form):
    """Nothing has to be said."""

    timeout_s: float | None = Field(default=None, gt=0.0, le=86_400.0, description="After which it is given up [s].")
