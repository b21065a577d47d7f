"""Figures as a client asks for them."""

from __future__ import annotations

import re
from typing import Any

from tests.server.service.running import ServiceReceiver

AT = "/api/v1/figures"
MOST_BYTES = 200_000


def shown(service: ServiceReceiver, path: str, **asked: Any) -> dict[str, Any]:
    answer = service.client().get(f"{AT}{path}", params=asked)
    assert answer.status_code == 200, answer.text
    assert len(answer.content) < MOST_BYTES
    body: dict[str, Any] = answer.json()
    assert body["schema"] == "fingertwin/figure/1"
    assert not re.search(r"</?[a-z]", body["text"])
    return body


def traces(body: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    found = body["figure"]["data"]
    return [t for t in found if (t["meta"].get("kind") if isinstance(t.get("meta"), dict) else t.get("meta")) == kind]
