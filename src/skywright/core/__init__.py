"""Shared types, rotations, clocks, units and the recording."""
