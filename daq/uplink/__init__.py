"""Store and forward: a journal streamed to the service, everything once in effect and in order, after any outage."""
