"""Motion planning for platform and arms together, in a configuration space described by data."""
