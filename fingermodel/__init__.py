"""Physics and inference: fingers, forces, comparison, refit. No hardware, no web."""
