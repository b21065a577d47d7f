"""The bench at a terminal: keys, traces, what to do now."""
