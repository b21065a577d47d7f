"""What the service keeps: its database and tables, checksums, messages, the audit trail, and what is removed for good.

It imports settings and answers only; it knows no request and no model.
"""
