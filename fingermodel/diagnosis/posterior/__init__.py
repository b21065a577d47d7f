"""The posterior: Gaussian algebra of the linearised model, hyperparameters, and the optimum of each explanation."""
