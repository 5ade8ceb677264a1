"""Comparison of two runs: `skywright compare runs A B`."""
