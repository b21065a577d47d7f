"""The service's log: lines to read, or JSON; each with the id of its request, none with a token or a body."""

from __future__ import annotations

import datetime as dt
import logging
import re
import sys
from contextvars import ContextVar
from typing import Any, TextIO

from pythonjsonlogger.json import JsonFormatter

from server.service.settings import Settings

REQUEST_ID: ContextVar[str] = ContextVar("request_id", default="")
# Loggers that say at each step what is of interest to their authors only.
_LOUD = ("alembic", "sqlalchemy", "jax", "httpx", "httpcore", "asyncio", "distributed", "websockets")
_TOKEN = re.compile(r"\bft_[0-9a-f]{8}_[0-9a-f]{8,}")
# What a database's driver adds to an error: the values, which are somebody's data.
_VALUES = re.compile(r"\[parameters: .*")
_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


def configure(settings: Settings, stream: TextIO | None = None) -> None:
    """Write everything that is logged in this process to standard error, in the settings' form."""
    handler = logging.StreamHandler(stream or sys.stderr)
    handler.setFormatter(JsonLines() if settings.log_format == "json" else TextLines())
    handler.addFilter(_with_request)
    root = logging.getLogger()
    for old in list(root.handlers):
        if isinstance(old.formatter, JsonLines | TextLines):
            root.removeHandler(old)
    root.addHandler(handler)
    root.setLevel(settings.log_level.upper())
    for name in _LOUD:
        logging.getLogger(name).setLevel(logging.WARNING)
    # Each request and WebSocket is told once, by the service itself; of uvicorn only what is wrong.
    for name in ("uvicorn", "uvicorn.error"):
        logger = logging.getLogger(name)
        logger.handlers.clear()
        logger.propagate = True
        logger.setLevel(logging.DEBUG if settings.log_level == "debug" else logging.WARNING)
    logging.getLogger("uvicorn.access").disabled = True
    logging.captureWarnings(capture=True)


def cleaned(text: str) -> str:
    """Return a text without tokens, values of a database, and characters that a terminal would obey."""
    return _UNSEEN.sub("?", _VALUES.sub("[parameters: …]", _TOKEN.sub("ft_…", text)))


class TextLines(logging.Formatter):
    """Time, level, who, which request, what."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(name)s%(request)s %(message)s")

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802
        """Return the time in UTC."""
        return _utc(record)

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, and a fault's trace below it."""
        request = vars(record).get("request_id")
        shown = {"request": f" [{request}]" if request else ""}
        # A text of a client's makes no lines of its own.
        shown["msg"] = record.getMessage().replace("\n", " ")
        plain = logging.makeLogRecord(vars(record) | shown | {"args": None})
        return cleaned(super().format(plain))


class JsonLines(JsonFormatter):
    """One JSON object a line: time, level, logger, message, request_id, and what is known of the request."""

    def __init__(self) -> None:
        super().__init__(
            "%(levelname)s %(name)s %(message)s %(request_id)s",
            rename_fields={"levelname": "level", "name": "logger"},
            json_ensure_ascii=False,
        )

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        """Return what is written, without what must not be."""
        found: dict[str, Any] = super().process_log_record(log_data)
        return {key: cleaned(value) if isinstance(value, str) else value for key, value in found.items()}

    def add_fields(self, log_data: dict[str, Any], record: logging.LogRecord, message_dict: dict[str, Any]) -> None:
        """Add the time."""
        log_data["time"] = _utc(record)
        super().add_fields(log_data, record, message_dict)


def _utc(record: logging.LogRecord) -> str:
    return dt.datetime.fromtimestamp(record.created, dt.UTC).isoformat(timespec="milliseconds")


def _with_request(record: logging.LogRecord) -> bool:
    vars(record)["request_id"] = REQUEST_ID.get()
    return True
