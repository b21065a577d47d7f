"""Tables of the service's database. Rows of readings, events, edits and revisions are added and never changed."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
)
from sqlalchemy.schema import SchemaItem

from server.service.storage.checksums import Sealed

# Names of constraints must be known to be changed by a migration.
NAMES = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "fk": "fk_%(table_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}
NAME, DIGEST, TIME = String(200), String(64), String(40)
# SQLite numbers only its own INTEGER by itself.
COUNT = BigInteger().with_variant(Integer, "sqlite")

metadata = MetaData(naming_convention=NAMES)


def _table(name: str, *columns: SchemaItem) -> Table:
    return Table(name, metadata, *columns)


sessions = _table(
    "sessions",
    Column("id", NAME, primary_key=True),
    Column("created_utc", TIME, nullable=False),
    # What was posted as bench-session/1; null where a bench's events are the record.
    Column("document", Sealed("document of sessions")),
    Column("specimen", NAME, index=True),
    # Raised by everything that changes cases, windows or model-free corrections.
    Column("version", Integer, nullable=False, default=0),
    Column("closed_utc", TIME),
    # A deleted session is hidden, and its id stays taken; its own document brings it back.
    Column("deleted_utc", TIME),
    # True while an import is written, which is hidden like a deleted session until all of it is there.
    Column("arriving", Boolean),
)

streams = _table(
    "streams",
    Column("session", NAME, ForeignKey("sessions.id"), primary_key=True),
    Column("id", NAME, primary_key=True),
    Column("number", Integer, nullable=False),
    Column("description", Text, nullable=False),
    Column("sha256", DIGEST, nullable=False),
    Column("next_seq", COUNT, nullable=False, default=0),
    # Samples that are stored; where it is less than next_seq, some are missing.
    Column("held", COUNT, nullable=False, default=0),
    Column("ended", Boolean, nullable=False, default=False),
    Column("epoch", NAME),
)

chunks = _table(
    "chunks",
    Column("session", NAME, primary_key=True),
    Column("stream", NAME, primary_key=True),
    Column("first_seq", COUNT, primary_key=True, autoincrement=False),
    Column("n", Integer, nullable=False),
    Column("first_s", Float),
    Column("last_s", Float),
    Column("sha256", DIGEST, nullable=False),
    Column("payload", LargeBinary, nullable=False),
    ForeignKeyConstraint(["session", "stream"], ["streams.session", "streams.id"]),
    Index(None, "session", "stream", "first_s"),
    Index(None, "session", "stream", "last_s"),
)

events = _table(
    "events",
    Column("session", NAME, ForeignKey("sessions.id"), primary_key=True),
    Column("epoch", NAME, primary_key=True),
    Column("number", COUNT, primary_key=True, autoincrement=False),
    # In which it came; epochs follow each other in this order.
    Column("arrival", COUNT, nullable=False),
    Column("sha256", DIGEST, nullable=False),
    Column("body", Text, nullable=False),
)

# What people changed of a session afterwards: a case added, a window moved, an exclusion, and undoing it.
edits = _table(
    "edits",
    Column("number", COUNT, primary_key=True, autoincrement=True),
    Column("session", NAME, ForeignKey("sessions.id"), nullable=False, index=True),
    Column("created_utc", TIME, nullable=False),
    Column("author", NAME),
    Column("kind", String(20), nullable=False),
    Column("case", NAME),
    Column("body", Sealed("body of edits")),
    Column("undoes", COUNT),
)

revisions = _table(
    "revisions",
    Column("id", NAME, primary_key=True),
    Column("specimen", NAME, nullable=False, index=True),
    Column("session", NAME, ForeignKey("sessions.id"), nullable=False, index=True),
    Column("parent", NAME, nullable=False),
    Column("created_utc", TIME, nullable=False),
    Column("document", Sealed("document of revisions"), nullable=False),
    # Which readings, corrections, model, job and version of the software it came from.
    Column("provenance", Sealed("provenance of revisions"), nullable=False),
)

# Which revision stands for a specimen: the latest row; restoring an older one adds a row.
heads = _table(
    "heads",
    Column("number", COUNT, primary_key=True, autoincrement=True),
    Column("specimen", NAME, nullable=False, index=True),
    Column("revision", NAME, ForeignKey("revisions.id"), nullable=False),
    Column("created_utc", TIME, nullable=False),
    Column("why", Text, nullable=False),
)

jobs = _table(
    "jobs",
    Column("id", NAME, primary_key=True),
    Column("number", COUNT, nullable=False, unique=True),
    Column("kind", String(40), nullable=False),
    Column("session", NAME, index=True),
    Column("request", Sealed("request of jobs"), nullable=False),
    # queued, running, done, failed, cancelled
    Column("state", String(20), nullable=False, index=True),
    Column("progress", Float, nullable=False, default=0.0),
    Column("stage", String(200), nullable=False, default=""),
    Column("attempts", Integer, nullable=False, default=0),
    Column("timeout_s", Float, nullable=False),
    Column("created_utc", TIME, nullable=False),
    Column("started_utc", TIME),
    Column("finished_utc", TIME),
    Column("result", Sealed("result of jobs")),
    # problem+json of a failure.
    Column("problem", Sealed("problem of jobs")),
)

# Finished parts of a job that is done in parts; a job that is taken up again does only the others.
job_parts = _table(
    "job_parts",
    Column("job", NAME, ForeignKey("jobs.id"), primary_key=True),
    Column("part", NAME, primary_key=True),
    Column("result", Sealed("result of job_parts"), nullable=False),
)

# Predictions of live explanations, stored before the cases are measured.
frozen = _table(
    "frozen",
    Column("sha256", DIGEST, primary_key=True),
    Column("specimen", NAME, nullable=False, index=True),
    Column("session", NAME, ForeignKey("sessions.id"), nullable=False),
    Column("created_utc", TIME, nullable=False),
    Column("document", Sealed("document of frozen"), nullable=False),
)

# The users' own effects; a name once taken keeps its meaning.
own_effects = _table(
    "own_effects",
    Column("name", NAME, primary_key=True),
    Column("created_utc", TIME, nullable=False),
    Column("document", Sealed("document of own_effects"), nullable=False),
)

# What is told live and can be asked for after a pause; traces are not kept.
messages = _table(
    "messages",
    Column("id", COUNT, primary_key=True, autoincrement=True),
    Column("session", NAME, index=True),
    Column("kind", String(40), nullable=False),
    Column("created_utc", TIME, nullable=False),
    Column("body", Sealed("body of messages"), nullable=False),
)

tokens = _table(
    "tokens",
    Column("id", NAME, primary_key=True),
    Column("name", NAME, nullable=False),
    Column("sha256", DIGEST, nullable=False, unique=True),
    # read or write
    Column("role", String(10), nullable=False),
    Column("created_utc", TIME, nullable=False),
    Column("expires_utc", TIME),
    Column("revoked_utc", TIME),
)

# Every change, by whom, when and from where; the database itself refuses to change or remove a row.
audit = _table(
    "audit",
    Column("number", COUNT, primary_key=True, autoincrement=False),
    Column("at_utc", TIME, nullable=False),
    Column("who", NAME, nullable=False),
    Column("origin", NAME, nullable=False),
    Column("what", String(40), nullable=False),
    Column("about", NAME, index=True),
    Column("details", Sealed("details of audit"), nullable=False),
    # SHA-256 of the entry before, which has no second one after it.
    Column("before", DIGEST, nullable=False, unique=True),
    Column("sha256", DIGEST, nullable=False),
)
