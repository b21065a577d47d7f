"""Bodies that a bench posts to a session's live path: envelopes of readings, as `daq.uplink.live_tail` makes them."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from server.service.web.examples import EXAMPLES

# Beyond any reading and any time, and far from where sums overflow.
MOST = 1e12

Reading = Annotated[float, Field(ge=-MOST, le=MOST, allow_inf_nan=False)]
Wrench = Annotated[list[Reading | None], Field(min_length=6, max_length=6)]
Time = Annotated[float, Field(ge=-MOST, le=MOST, allow_inf_nan=False)]


class Envelope(BaseModel):
    """Some hundredths of a second of one stream. Six-vectors are Fx Fy Fz [N], Tx Ty Tz [N mm], in the cell's axes."""

    model_config = ConfigDict(strict=True, frozen=True, json_schema_extra={"example": EXAMPLES["Envelope"]})

    stream: str = Field(min_length=1, max_length=100, description="Id of the stream.")
    from_s: Time = Field(description="Time of the first reading since the stream began [s].")
    to_s: Time = Field(description="Time of the last reading [s].")
    count: int = Field(ge=1, le=1_000_000, description="Number of readings.")
    latest: Wrench = Field(description="The last reading; null where a component is no number.")
    least: Wrench = Field(description="The least of each component.")
    most: Wrench = Field(description="The greatest of each component.")
    mean: Wrench | None = Field(default=None, description="The mean of each component.")
    overload: bool = Field(default=False, description="Whether any reading was beyond the cell's range.")

    @model_validator(mode="after")
    def _in_order(self) -> Envelope:
        if self.to_s < self.from_s:
            raise ValueError("to_s lies before from_s")
        if any(a is not None and b is not None and b < a for a, b in zip(self.least, self.most, strict=True)):
            raise ValueError("most is below least")
        return self


class LiveMessage(BaseModel):
    """Envelopes of one bench, the oldest first, and how many it could not send since it began."""

    model_config = ConfigDict(strict=True, frozen=True, json_schema_extra={
        "example": {"dropped": 0, "envelopes": [EXAMPLES["Envelope"]]},
    })  # fmt: skip

    envelopes: list[Envelope] = Field(max_length=500, description="Of one or several streams.")
    dropped: int = Field(default=0, ge=0, le=1 << 53, description="Envelopes that were never sent.")


class BenchKey(BaseModel):
    """Something that a bench can be asked for."""

    model_config = ConfigDict(strict=True, frozen=True)

    command: str = Field(min_length=1, max_length=40, description="Its name.")
    key: str = Field(max_length=10, description="That gives it at the bench's own keyboard; empty where none does.")
    title: str = Field(max_length=100, description="What it is called.")
    asks: str | None = Field(default=None, max_length=200, description="The question whose answer belongs to it.")
    begins: str = Field(default="", max_length=200, description="What that answer begins with, unless it is changed.")


class BenchShown(BaseModel):
    """Request of a running bench to its user."""

    model_config = ConfigDict(strict=True, frozen=True)

    step: str = Field(max_length=500, description="What is to hang where.")
    todo: str = Field(max_length=500, description="What is to be done now.")
    phase: str = Field(max_length=20, description="idle, unloaded or loaded.")
    reason: str = Field(max_length=500, description="Why there is no plateau yet.")
    suggested: str = Field(
        max_length=40, description="The command that comes next; empty while something is waited for."
    )
    closed: bool = Field(description="Whether the session is closed.")
    keys: tuple[BenchKey, ...] = Field(max_length=40, description="What it can be asked for.")


class Answer(BaseModel):
    """A bench's answer to a command."""

    model_config = ConfigDict(strict=True, frozen=True)

    number: int = Field(ge=0, le=1 << 53)
    refused: str | None = Field(default=None, max_length=2000, description="Why it was not carried out.")


class BenchMessage(LiveMessage):
    """Message of a bench through its WebSocket: envelopes, a changed request to the user, answers to commands."""

    bench: BenchShown | None = None
    answers: list[Answer] = Field(default_factory=list, max_length=100)
