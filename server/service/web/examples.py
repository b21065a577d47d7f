"""Examples of what is sent and answered, by the name of its form, as the OpenAPI document shows them."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

EXAMPLES: dict[str, Any] = json.loads((files("server.service.web") / "examples.json").read_bytes())
