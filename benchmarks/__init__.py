"""What is timed, against what. Importing this package confines the process to one core, before NumPy or JAX start."""

from benchmarks.machine import use_one_core

use_one_core()
