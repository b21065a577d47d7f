"""Compiled models: where they are kept between runs, and programs that start quickly.

It imports nothing of the model.
"""
