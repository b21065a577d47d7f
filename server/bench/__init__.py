"""The bench at a terminal: keys, traces, what to do now. It may ask the application, and is shown by commands alone."""
