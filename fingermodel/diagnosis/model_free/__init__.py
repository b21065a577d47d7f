"""Tests that need no model of the tendons: balance at both mounts, superposition, frames, loads, tares."""
