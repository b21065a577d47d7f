"""The client stands alone: it runs where neither the model nor the service is installed."""

from __future__ import annotations

import fingertwin
from tests.contracts.test_layers import every_module_of, loaded_by

MODEL_AND_SERVICE = {"server", "fingermodel", "jax", "jaxlib", "scipy", "fastapi", "uvicorn", "sqlalchemy", "typer"}
LOADED_WHEN_NEEDED = {"plotly", "websockets", "pydantic", "yaml", "pyarrow"}


def test_it_loads_nothing_of_the_model_or_the_service() -> None:
    modules = every_module_of(fingertwin.__path__, "fingertwin")
    assert "fingertwin.client.upload" in modules
    loaded = loaded_by(*modules)
    assert "httpx" in loaded
    assert loaded.isdisjoint(MODEL_AND_SERVICE)


def test_it_starts_light() -> None:
    assert loaded_by("fingertwin.client").isdisjoint(LOADED_WHEN_NEEDED)
    assert loaded_by("fingertwin").isdisjoint({"httpx", "numpy", "daq"})
