"""Fingers as files of other software, and back: OpenSim's `.osim` and MuJoCo's MJCF, as text alone."""
