"""Comparison of planners: the default one, the paper's, and OMPL's (a benchmark-only
dependency)."""
