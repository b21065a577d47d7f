"""What a user asks for, as functions that take and return values; nothing here parses arguments or prints.

The command line and the service both build on it, and never on each other. It may use figures, the model and the
bench.
"""
