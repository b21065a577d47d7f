"""From the force at the tip back to what pulls and presses inside the finger, under a stated assumption."""
