"""Claims, benchmarks, planner comparisons and pictures."""
