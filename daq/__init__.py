"""Instruments and records: readings, sessions and their corrections. No JAX, no web."""
