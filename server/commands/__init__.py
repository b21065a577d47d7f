"""What each command prints, once its arguments are parsed; what it works out is asked of `server.application`.

Nothing here may import the service, but for `service`: the commands that start it and keep its data.
"""
