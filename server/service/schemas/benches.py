"""Forms of what is asked of a running bench."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from server.service.schemas.common import Form, Shown


class BenchCommand(Form):
    """A command for a bench."""

    model_config = ConfigDict(json_schema_extra={"example": {"command": "tare", "text": ""}})

    command: str = Field(min_length=1, max_length=40, description="One that the bench lists in its `keys`.")
    text: str = Field(default="", max_length=500, description="What belongs to it: a reason, a note, a known weight.")


class Done(Shown):
    """Command that the bench has carried out; its results follow as events."""

    session: str
    command: str
