"""Localisation from two sources: trajectories, clocks, frames, drift."""
