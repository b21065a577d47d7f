"""Where compiled models are kept between runs."""

from __future__ import annotations

import os


def prepare_jax() -> None:
    """Keep compiled models between runs, in the user's cache folder, unless the user has chosen one."""
    import jax
    from platformdirs import user_cache_path

    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(user_cache_path("fingertwin") / "compiled"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
