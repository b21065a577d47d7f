"""Readings files: CSV and Parquet as blocks, what their columns mean, windows of time, and what each window reduces to.

It imports what lies at the top of `daq`.
"""
