"""Figures, and what pages show of fingers and forces, as answers with words.

It imports `models` and what stands below.
"""
