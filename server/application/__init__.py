"""Everything a user can ask for, as functions of values; nothing here parses arguments or prints.

The command line and the service both build on it, and never on each other. It may use figures, the model and the
bench.
"""
