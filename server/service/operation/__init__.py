"""How the service is kept: its data folder, schema versions, backups, checks of what is stored, and its health.

It imports `storage` and settings; `serve`, `services` and the command line call it.
"""
