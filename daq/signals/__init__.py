"""From windows to one wrench a load case: gauges, tares, mount axes, known weights, friction.

It imports `recordings` and `sessions`.
"""
