"""Forms of stored readings and events."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from server.service.schemas.common import Answered, Shown

Column = list[float | None]
Channels = Annotated[
    dict[str, Column],
    Field(description="By channel: Fx_N, Fy_N, Fz_N, Tx_Nmm, Ty_Nmm, Tz_Nmm, in the cell's own axes."),
]
ByChannel = dict[str, float | None]


class WindowShown(Shown):
    """Readings of a window of time: as they are, or as least and most of each stretch."""

    stream: str = Field(description="Of the session.")
    kind: Literal["raw", "envelope"] = Field(description="raw: each reading; envelope: least and most.")
    frame: str
    window_s: Annotated[list[float], Field(min_length=2, max_length=2, description="First and last time [s].")]
    stream_s: list[float] | None = Field(description="First and last time of the whole stream; null where it is empty.")
    samples: int = Field(description="Readings in the window.")
    flagged_samples: int = Field(description="Of them, how many the cell or its range flags.")
    missing_s: list[list[float]] = Field(description="[from, to] of which readings are missing, such as not yet sent.")
    t_s: Column | None = Field(None, description="raw: time of each reading [s].")
    values: Channels | None = None
    from_s: Column | None = Field(None, description="envelope: time of the first reading of each stretch [s].")
    to_s: Column | None = Field(None, description="envelope: and of its last [s].")
    count: list[int] | None = Field(None, description="envelope: readings in it.")
    flagged: list[int] | None = Field(None, description="How many of each stretch are flagged; of raw ones 1 or 0.")
    least: Channels | None = None
    most: Channels | None = None


class ReadingsShown(WindowShown):
    """Readings of a session."""

    schema_: str = Field(alias="schema", examples=["fingertwin/readings/1"])
    session: str


class PlateauShown(Shown):
    """A window that was reduced, in the cell's own axes."""

    readings: int
    start_s: float
    end_s: float
    mean: ByChannel
    sd: ByChannel = Field(description="Of the readings.")
    sd_of_mean: ByChannel = Field(description="Standard uncertainty of the mean.")
    slope_per_s: ByChannel
    slope_sd_per_s: ByChannel
    effective: ByChannel = Field(description="Independent readings that it is worth.")
    flagged: int
    steady: bool | None = Field(description="Null where that is open.")


class CaseWindowShown(Shown):
    """A window of a load case."""

    name: str = Field(description="unloaded_s, loaded_s or unloaded_after_s.")
    window_s: list[float]
    state: Literal["measured", "waiting", "failed"]
    why: str
    plateau: PlateauShown | None
    readings: WindowShown = Field(description="Of the window, and of a margin before and after it.")


class CaseReadingsShown(Shown):
    """The windows of a load case."""

    schema_: str = Field(alias="schema", examples=["fingertwin/case-readings/1"])
    session: str
    session_version: int
    case: str
    windows: list[CaseWindowShown]


class EventShown(Shown):
    """Something that happened at the bench, as it was sent."""

    epoch: str = Field(description="History of the bench's journal.")
    number: int = Field(description="In its epoch, from 0.")
    arrival: int = Field(description="In which it came, over all epochs.")
    kind: str
    at_s: float | None = Field(None, description="Time of the stream [s].")
    utc_s: float | None = Field(None, description="Wall clock of the bench [s since 1970].")
    stream: str | None = None
    value: dict[str, Any] | None = None


class EventsShown(Answered):
    """Events in the order in which they came."""

    session: str
    events: list[EventShown]
    next: int | None = Field(description="To be given as `after` for more; null where there are no more.")
