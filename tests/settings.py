"""Hypothesis for numerical code: compilation makes first examples slow, so no deadline; seeded, so runs repeat."""

from __future__ import annotations

from hypothesis import HealthCheck, settings


def load_profile() -> None:
    settings.register_profile(
        "fingertwin",
        deadline=None,
        derandomize=True,
        max_examples=50,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    settings.load_profile("fingertwin")
