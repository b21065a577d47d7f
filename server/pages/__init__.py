"""The browser bench: pages that are a pure client of the service's documented interface."""
