"""Which hypotheses are fitted: the beginning, cases taken for bad, and the search beside them."""
