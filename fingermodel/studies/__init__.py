"""Questions put to a finger that a bench session does not ask: scaling, movement, activation, inversion, species.

Each takes and returns values; it may use the model and inference, and knows no figure, no page and no command line.
"""
