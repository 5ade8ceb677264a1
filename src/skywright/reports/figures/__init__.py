"""Figures of a run's report: one style, limits drawn, phases named."""
