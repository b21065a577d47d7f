"""Steps from one version of the database's schema to the next.

Alembic runs them; `server.service.operation.migrate` calls it.
"""
