"""What is timed, against what. A command of this package has one core, before NumPy or JAX start.

Importing the package changes nothing: tests import parts of it, and their process would keep one core.
"""

import sys

from benchmarks.machine import use_one_core

if any(
    run.startswith("benchmarks.") for flag, run in zip(sys.orig_argv, sys.orig_argv[1:], strict=False) if flag == "-m"
):
    use_one_core()
