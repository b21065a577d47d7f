"""Sessions as they are stored: records, edits, plans, what is measured, and what may be seen while a bench runs.

It imports `ingest` and what stands below; it knows no model of a finger.
"""
