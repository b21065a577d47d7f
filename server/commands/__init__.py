"""Printing of each command, after its arguments are parsed; the work is done by `server.application`.

Nothing here may import the service, but for `service`: the commands that start it and keep its data.
"""
