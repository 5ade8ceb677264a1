"""`skywright bench`: computing times, as ratios of cases measured in turns in one process."""
