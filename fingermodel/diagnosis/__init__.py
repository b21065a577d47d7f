"""What is missing in a model, by one posterior over what may act.

One package for each part of the method: `session_model` the generative model of a session; `posterior` its evidence;
`search` what is fitted; `verdict` what is said; `model_free` tests without a model of the tendons; `next_cases` what to
measure next; `several_sessions` what specimens share. `diagnose` runs them in order; every number assumed stands in
`settings`.
"""
