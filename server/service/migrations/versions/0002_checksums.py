"""Every document has its checksum; an import that is not complete is hidden."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

# The key and the columns of JSON of each table.
DOCUMENTS = {
    "sessions": (("id",), ("document",)),
    "edits": (("number",), ("body",)),
    "revisions": (("id",), ("document", "provenance")),
    "jobs": (("id",), ("request", "result", "problem")),
    "job_parts": (("job", "part"), ("result",)),
    "frozen": (("sha256",), ("document",)),
    "own_effects": (("name",), ("document",)),
    "messages": (("id",), ("body",)),
}
_AT_ONCE = 500


def upgrade() -> None:
    """Make texts of the documents, and give each its SHA-256."""
    op.add_column("sessions", sa.Column("arriving", sa.Boolean()))
    for name, (key, columns) in DOCUMENTS.items():
        with op.batch_alter_table(name) as table:
            for column in columns:
                table.alter_column(column, type_=sa.Text(), postgresql_using=f'"{column}"::text')
        _seal(op.get_bind(), sa.table(name, *(sa.column(c) for c in (*key, *columns))), key, columns)


def _seal(connection: sa.Connection, table: sa.TableClause, key: tuple[str, ...], columns: tuple[str, ...]) -> None:
    keys = sa.tuple_(*(table.c[k] for k in key))
    change = sa.update(table).where(*(table.c[k] == sa.bindparam(f"key_{k}") for k in key))
    change = change.values({c: sa.bindparam(f"new_{c}") for c in columns})
    all_keys = [tuple(row) for row in connection.execute(sa.select(*(table.c[k] for k in key)))]
    for at in range(0, len(all_keys), _AT_ONCE):
        rows = connection.execute(sa.select(table).where(keys.in_(all_keys[at : at + _AT_ONCE]))).mappings().all()
        connection.execute(
            change, [{f"key_{k}": row[k] for k in key} | {f"new_{c}": _sealed(row[c]) for c in columns} for row in rows]
        )


def _sealed(text: Any) -> str | None:
    # Nothing was written as JSON's null.
    if text is None or text == "null":
        return None
    try:
        json.loads(text)
    except ValueError:
        # Damaged before there were checksums: kept as it is, under one that never holds.
        return f"{'0' * 64} {text}"
    return f"{hashlib.sha256(text.encode()).hexdigest()} {text}"
