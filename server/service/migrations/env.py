"""Alembic's environment: steps run on the connection that `server.service.operation.migrate` has opened and locked."""

from __future__ import annotations

from alembic import context

from server.service.storage.schema import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    # SQLite changes most of a table only by copying it.
    render_as_batch=True,
    # All steps or none: the transaction is the caller's.
    transactional_ddl=True,
)
context.run_migrations()
