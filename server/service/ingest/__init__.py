"""Readings and events of benches: taken in once, cut into windows, and told as envelopes.

It imports `web` and `storage`.
"""
