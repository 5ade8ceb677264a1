"""Figures of a run's report, in one style, with limits and names of phases."""
