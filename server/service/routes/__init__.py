"""The addresses of the service, below /api/v1."""
