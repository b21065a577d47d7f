"""Which load cases would tell live hypotheses apart, and how a prediction is frozen before it is measured."""
