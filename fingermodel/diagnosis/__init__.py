"""Which physical effect is missing: screening, refits, evidence, what cannot be told apart, and the verdict."""
