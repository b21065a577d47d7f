"""Sessions for other software and for a paper: tables, Excel, HDF5, MATLAB, C3D, and the supplement.

It imports `checks`, `signals`, `recordings` and `sessions`.
"""
