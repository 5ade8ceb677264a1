"""Probability of detection: curves from inspections of known flaws, from files or flights."""
