"""Examples of what is sent and answered, by the name of its form, as the OpenAPI document shows them."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

EXAMPLES: dict[str, Any] = {
    name: body
    for file in files("server.service.web").joinpath("example_bodies").iterdir()
    for name, body in json.loads(file.read_bytes()).items()
}
