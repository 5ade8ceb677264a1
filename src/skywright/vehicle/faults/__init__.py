"""What can go wrong in the plant: one file a fault, `[plant.faults.NAME] kind = ...`."""
