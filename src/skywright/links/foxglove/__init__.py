"""Live view in Foxglove with its SDK."""
