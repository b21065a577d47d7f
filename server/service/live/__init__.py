"""What is told live: traces that hide no peak, what was kept, and what the hanging weight reads, over one WebSocket."""
