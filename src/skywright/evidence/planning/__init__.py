"""Planners compared: ours, the paper's, and OMPL's (a benchmark-only dependency)."""
