"""Where compiled models are kept between runs."""

from __future__ import annotations

import contextlib
import os
import warnings
from functools import cache
from pathlib import Path


def prepare_jax() -> None:
    """Keep compiled models between runs, in the user's cache folder, unless the user has chosen one."""
    import jax
    from platformdirs import user_cache_path

    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(user_cache_path("fingertwin") / "compiled"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    _mend(str(jax.config.values["jax_compilation_cache_dir"]))


@cache
def _mend(folder: str) -> None:
    """Remove what a process that was killed has left half written; of another one's it is only compiled once more.

    JAX writes what it has compiled in place, complains of an empty file at every start, and never mends it.
    """
    warnings.filterwarnings("ignore", "Error reading persistent compilation cache entry", UserWarning)
    with contextlib.suppress(OSError):
        for file in Path(folder).glob("*-cache"):
            if not file.stat().st_size:
                file.unlink(missing_ok=True)
