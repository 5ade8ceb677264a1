"""Live view in Foxglove by its own SDK."""
