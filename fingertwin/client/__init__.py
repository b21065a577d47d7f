"""A client of the model service: upload a session, compare, refit, diagnose, add what is missing.

    from fingertwin.client import Client

    with Client("http://127.0.0.1:8765") as twin:
        session = twin.upload("sessions/DEV-02")
        print(session.compare().rmse_N("validation/tip"))
        finding = session.diagnose().result(progress=print)
        print(finding.sentence)

Units are in the names: `_N`, `_Nmm`, `_g`, `_deg`, `_s`. Axes: x proximal, y dorsal, z radial. Whatever the service
refuses is a `ServiceError` of one line that says what was found, what was expected and what to do.
"""

from __future__ import annotations

from fingertwin.client.client import Client
from fingertwin.client.comparison import ComparedCase, Comparison
from fingertwin.client.errors import JobFailedError, ServiceError, ServiceUnreachableError
from fingertwin.client.files import Check, Readings
from fingertwin.client.findings import Explanation, Finding, Fit, NextCase, Plan
from fingertwin.client.jobs import Job
from fingertwin.client.live import Message
from fingertwin.client.predictions import Prediction
from fingertwin.client.records import Edit, Effect, Friction, Health, LoadCase, SessionInfo
from fingertwin.client.revisions import Revision, Step
from fingertwin.client.session import Session
from fingertwin.client.summaries import Errors, InPlanes, Parameter

__all__ = [
    "Check",
    "Client",
    "ComparedCase",
    "Comparison",
    "Edit",
    "Effect",
    "Errors",
    "Explanation",
    "Finding",
    "Fit",
    "Friction",
    "Health",
    "InPlanes",
    "Job",
    "JobFailedError",
    "LoadCase",
    "Message",
    "NextCase",
    "Parameter",
    "Plan",
    "Prediction",
    "Readings",
    "Revision",
    "ServiceError",
    "ServiceUnreachableError",
    "Session",
    "SessionInfo",
    "Step",
]
