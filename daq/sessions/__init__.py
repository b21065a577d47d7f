"""Bench sessions as files: `bench-session/1` folders, their records and rules, amendments, and protocols.

It imports what lies at the top of `daq`: errors, documents, vocabulary. It knows no reading and no correction.
"""

from __future__ import annotations

from daq.sessions.files import (
    AMENDMENTS_FILE,
    AMENDMENTS_FORMAT,
    FINGER_DOCUMENT,
    SESSION_FILE,
    faults_of,
    find_session,
    parse_session,
    plain_document,
    read_amendments,
    read_session,
    read_yaml,
    require_once,
    session_data,
    session_names,
    session_text,
    whole_document,
    write_session,
)
from daq.sessions.models import (
    FORMAT,
    Amendment,
    Environment,
    Event,
    KnownWeight,
    LoadCase,
    LoadCell,
    Location,
    Mount,
    Posture,
    Session,
    Specimen,
    TensionEstimate,
)
from daq.vocabulary import LOCATIONS, ROLES, TENDONS

__all__ = [
    "AMENDMENTS_FILE",
    "AMENDMENTS_FORMAT",
    "FINGER_DOCUMENT",
    "FORMAT",
    "LOCATIONS",
    "ROLES",
    "SESSION_FILE",
    "TENDONS",
    "Amendment",
    "Environment",
    "Event",
    "KnownWeight",
    "LoadCase",
    "LoadCell",
    "Location",
    "Mount",
    "Posture",
    "Session",
    "Specimen",
    "TensionEstimate",
    "faults_of",
    "find_session",
    "parse_session",
    "plain_document",
    "read_amendments",
    "read_session",
    "read_yaml",
    "require_once",
    "session_data",
    "session_names",
    "session_text",
    "whole_document",
    "write_session",
]
