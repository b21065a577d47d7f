"""The only package that knows both the bench and the model: command line, figures, service.

Importing it settles how many threads linear algebra uses, which must be done before NumPy and SciPy load: one. The
matrices of a session are too small to share. Two threads that wait for each other beside a busy acquisition made a
refit thirty times slower (0.3 s to 10 s, measured on two cores). What the user has set is left alone.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
