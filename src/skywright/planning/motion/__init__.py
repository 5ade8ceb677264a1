"""Motion planning for platform and arms together in a configuration space defined by data."""
