"""Probability of detection: curves from inspections of known flaws, in files or in flights."""
