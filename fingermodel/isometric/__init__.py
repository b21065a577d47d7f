"""Fingers at isometric equilibrium: Hill muscles on tendons, wrapping surfaces, passive joint torques, tip force."""
