"""Faults of the plant: one file a fault, `[plant.faults.NAME] kind = ...`."""
