"""Readings as they are taken: transports, the sampling thread, the sample clock, and chunks.

It imports `drivers`, and knows neither journal nor session.
"""
