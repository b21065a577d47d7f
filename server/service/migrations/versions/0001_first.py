"""The first schema."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

NAME, DIGEST, TIME = sa.String(200), sa.String(64), sa.String(40)
COUNT = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    """Make all tables."""
    _readings()
    _changes()
    _work()
    _rest()


def _readings() -> None:
    op.create_table(
        "sessions",
        sa.Column("id", NAME, nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("document", sa.JSON()),
        sa.Column("specimen", NAME),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("closed_utc", TIME),
        sa.Column("deleted_utc", TIME),
        sa.PrimaryKeyConstraint("id", name="pk_sessions"),
    )
    op.create_index("ix_sessions_specimen", "sessions", ["specimen"])
    op.create_table(
        "streams",
        sa.Column("session", NAME, nullable=False),
        sa.Column("id", NAME, nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("description", sa.Text(), nullable=False),
        sa.Column("sha256", DIGEST, nullable=False),
        sa.Column("next_seq", COUNT, nullable=False),
        sa.Column("held", COUNT, nullable=False),
        sa.Column("ended", sa.Boolean(), nullable=False),
        sa.Column("epoch", NAME),
        sa.PrimaryKeyConstraint("session", "id", name="pk_streams"),
        sa.ForeignKeyConstraint(["session"], ["sessions.id"], name="fk_streams_sessions"),
    )
    op.create_table(
        "chunks",
        sa.Column("session", NAME, nullable=False),
        sa.Column("stream", NAME, nullable=False),
        sa.Column("first_seq", COUNT, nullable=False, autoincrement=False),
        sa.Column("n", sa.Integer(), nullable=False),
        sa.Column("first_s", sa.Float()),
        sa.Column("last_s", sa.Float()),
        sa.Column("sha256", DIGEST, nullable=False),
        sa.Column("payload", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("session", "stream", "first_seq", name="pk_chunks"),
        sa.ForeignKeyConstraint(["session", "stream"], ["streams.session", "streams.id"], name="fk_chunks_streams"),
    )
    op.create_index("ix_chunks_session_stream_first_s", "chunks", ["session", "stream", "first_s"])
    op.create_index("ix_chunks_session_stream_last_s", "chunks", ["session", "stream", "last_s"])
    op.create_table(
        "events",
        sa.Column("session", NAME, nullable=False),
        sa.Column("epoch", NAME, nullable=False),
        sa.Column("number", COUNT, nullable=False, autoincrement=False),
        sa.Column("arrival", COUNT, nullable=False),
        sa.Column("sha256", DIGEST, nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("session", "epoch", "number", name="pk_events"),
        sa.ForeignKeyConstraint(["session"], ["sessions.id"], name="fk_events_sessions"),
    )


def _changes() -> None:
    op.create_table(
        "edits",
        sa.Column("number", COUNT, nullable=False, autoincrement=True),
        sa.Column("session", NAME, nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("author", NAME),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("case", NAME),
        sa.Column("body", sa.JSON()),
        sa.Column("undoes", COUNT),
        sa.PrimaryKeyConstraint("number", name="pk_edits"),
        sa.ForeignKeyConstraint(["session"], ["sessions.id"], name="fk_edits_sessions"),
    )
    op.create_index("ix_edits_session", "edits", ["session"])
    op.create_table(
        "revisions",
        sa.Column("id", NAME, nullable=False),
        sa.Column("specimen", NAME, nullable=False),
        sa.Column("session", NAME, nullable=False),
        sa.Column("parent", NAME, nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.Column("provenance", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_revisions"),
        sa.ForeignKeyConstraint(["session"], ["sessions.id"], name="fk_revisions_sessions"),
    )
    op.create_index("ix_revisions_session", "revisions", ["session"])
    op.create_index("ix_revisions_specimen", "revisions", ["specimen"])
    op.create_table(
        "heads",
        sa.Column("number", COUNT, nullable=False, autoincrement=True),
        sa.Column("specimen", NAME, nullable=False),
        sa.Column("revision", NAME, nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("why", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("number", name="pk_heads"),
        sa.ForeignKeyConstraint(["revision"], ["revisions.id"], name="fk_heads_revisions"),
    )
    op.create_index("ix_heads_specimen", "heads", ["specimen"])


def _work() -> None:
    op.create_table(
        "jobs",
        sa.Column("id", NAME, nullable=False),
        sa.Column("number", COUNT, nullable=False),
        sa.Column("kind", sa.String(40), nullable=False),
        sa.Column("session", NAME),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("state", sa.String(20), nullable=False),
        sa.Column("progress", sa.Float(), nullable=False),
        sa.Column("stage", sa.String(200), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("timeout_s", sa.Float(), nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("started_utc", TIME),
        sa.Column("finished_utc", TIME),
        sa.Column("result", sa.JSON()),
        sa.Column("problem", sa.JSON()),
        sa.PrimaryKeyConstraint("id", name="pk_jobs"),
        sa.UniqueConstraint("number", name="uq_jobs_number"),
    )
    op.create_index("ix_jobs_session", "jobs", ["session"])
    op.create_index("ix_jobs_state", "jobs", ["state"])
    op.create_table(
        "job_parts",
        sa.Column("job", NAME, nullable=False),
        sa.Column("part", NAME, nullable=False),
        sa.Column("result", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("job", "part", name="pk_job_parts"),
        sa.ForeignKeyConstraint(["job"], ["jobs.id"], name="fk_job_parts_jobs"),
    )
    op.create_table(
        "frozen",
        sa.Column("sha256", DIGEST, nullable=False),
        sa.Column("specimen", NAME, nullable=False),
        sa.Column("session", NAME, nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("sha256", name="pk_frozen"),
        sa.ForeignKeyConstraint(["session"], ["sessions.id"], name="fk_frozen_sessions"),
    )
    op.create_index("ix_frozen_specimen", "frozen", ["specimen"])


def _rest() -> None:
    op.create_table(
        "own_effects",
        sa.Column("name", NAME, nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("name", name="pk_own_effects"),
    )
    op.create_table(
        "messages",
        sa.Column("id", COUNT, nullable=False, autoincrement=True),
        sa.Column("session", NAME),
        sa.Column("kind", sa.String(40), nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("body", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_messages"),
    )
    op.create_index("ix_messages_session", "messages", ["session"])
    op.create_table(
        "tokens",
        sa.Column("id", NAME, nullable=False),
        sa.Column("name", NAME, nullable=False),
        sa.Column("sha256", DIGEST, nullable=False),
        sa.Column("role", sa.String(10), nullable=False),
        sa.Column("created_utc", TIME, nullable=False),
        sa.Column("expires_utc", TIME),
        sa.Column("revoked_utc", TIME),
        sa.PrimaryKeyConstraint("id", name="pk_tokens"),
        sa.UniqueConstraint("sha256", name="uq_tokens_sha256"),
    )
