"""The answer of one session: where the model fails, how large a finding is, what an added effect changed."""
