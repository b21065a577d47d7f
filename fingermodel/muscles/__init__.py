"""Hill-type muscles: their curves, their parameters as files, and isometric equilibrium of fibre and tendon."""
