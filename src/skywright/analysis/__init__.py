"""Work on many runs or on data."""
