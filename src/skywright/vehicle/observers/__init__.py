"""Observers of the truth: quantities from MuJoCo's state for the plant and the recording."""
