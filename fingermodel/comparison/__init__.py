"""A measured session as arrays, with the covariance of what was read, and measured against predicted forces.

It imports the model and `daq`'s records of what was measured; it corrects no reading.
"""
