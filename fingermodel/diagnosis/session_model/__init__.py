"""The model of a session: explanations and their priors, the nuisances of rig and cell, and the discrepancies."""
