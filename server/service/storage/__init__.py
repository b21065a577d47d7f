"""Storage of the service: database and tables, checksums, messages, audit trail, permanent removal.

It imports settings and answers only; it knows no request and no model.
"""
