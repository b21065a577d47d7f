"""Operation of the service: data folder, schema versions, backups, checks of stored data, and health.

It imports `storage` and settings; `serve`, `services` and the command line call it.
"""
