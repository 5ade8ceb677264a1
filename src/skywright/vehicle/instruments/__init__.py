"""Instruments: what the robot carries to inspect."""
