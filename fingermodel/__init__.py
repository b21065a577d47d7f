"""Physics and inference: fingers, forces, comparison, refit, diagnosis. No hardware, no web.

From a notebook or a script: `from fingermodel import Session, compare, refit, diagnose, add, predict, save`. A session
is opened from its folder (`Session.open`); every step takes values and returns values.

Importing the package is quick: what a name needs is imported when it is first used. `server` and `fingertwin` are built
on it; it knows neither. Units are in the names: `_N`, `_Nmm`, `_g`, `_deg`. Axes: x proximal, y dorsal, z radial.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from daq.errors import InputError, ModelError, SessionError
    from fingermodel.api import Diagnosis, add, diagnose, refit, save
    from fingermodel.comparing import compare
    from fingermodel.comparison.comparison import CaseComparison, Comparison, ErrorSummary
    from fingermodel.diagnosis.answer.addition import Addition
    from fingermodel.effects.catalogue import CATALOGUE
    from fingermodel.effects.user import load_effect
    from fingermodel.fingers import Finger, Topology
    from fingermodel.fingers.files import finger_names, read_finger
    from fingermodel.fitting.fit_report import Fit, FittedParameter
    from fingermodel.model import Model
    from fingermodel.model_files import Revision, read_revision
    from fingermodel.parameters import Parameter, one_sided, two_sided
    from fingermodel.predicting import PredictedForces, predict
    from fingermodel.session import Session
    from fingermodel.stages import Effect, Layout, LoadCaseInput, State

__all__ = [
    "CATALOGUE",
    "Addition",
    "CaseComparison",
    "Comparison",
    "Diagnosis",
    "Effect",
    "ErrorSummary",
    "Finger",
    "Fit",
    "FittedParameter",
    "InputError",
    "Layout",
    "LoadCaseInput",
    "Model",
    "ModelError",
    "Parameter",
    "PredictedForces",
    "Revision",
    "Session",
    "SessionError",
    "State",
    "Topology",
    "add",
    "compare",
    "diagnose",
    "finger_names",
    "load_effect",
    "one_sided",
    "predict",
    "read_finger",
    "read_revision",
    "refit",
    "save",
    "two_sided",
]

_MODULES = {
    "daq.errors": ("InputError", "ModelError", "SessionError"),
    "fingermodel.api": ("Diagnosis", "add", "diagnose", "refit", "save"),
    "fingermodel.comparing": ("compare",),
    "fingermodel.comparison.comparison": ("CaseComparison", "Comparison", "ErrorSummary"),
    "fingermodel.diagnosis.answer.addition": ("Addition",),
    "fingermodel.effects.catalogue": ("CATALOGUE",),
    "fingermodel.effects.user": ("load_effect",),
    "fingermodel.fingers.files": ("finger_names", "read_finger"),
    "fingermodel.fingers": ("Finger", "Topology"),
    "fingermodel.fitting.fit_report": ("Fit", "FittedParameter"),
    "fingermodel.model": ("Model",),
    "fingermodel.model_files": ("Revision", "read_revision"),
    "fingermodel.parameters": ("Parameter", "one_sided", "two_sided"),
    "fingermodel.predicting": ("PredictedForces", "predict"),
    "fingermodel.session": ("Session",),
    "fingermodel.stages": ("Effect", "Layout", "LoadCaseInput", "State"),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List public names, too, before they are imported."""
    return sorted({*globals(), *__all__})
