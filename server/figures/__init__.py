"""Figures and reports: every figure is one Plotly figure, drawn by the browser or, without one, by Matplotlib.

They are built on the model alone, and know no command and no service. Nothing is imported here: Plotly and Matplotlib
load with the module that needs them.
"""
