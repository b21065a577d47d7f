"""Figures and reports: every figure is one Plotly figure, drawn by the browser or, without one, by Matplotlib.

Nothing is imported here: Plotly and Matplotlib load with the module that needs them.
"""
