"""Forms of what is sent and answered: they check requests, and document answers."""
