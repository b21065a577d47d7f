"""A refit: what is minimised, how, and what came out; and the published identification (Synek et al. 2019, Eq 5).

It imports `comparison` and the model; it reads no files.
"""
