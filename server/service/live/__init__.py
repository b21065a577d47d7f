"""Live messages over one WebSocket: traces that hide no peak, kept messages, and the estimate of the hanging weight."""
