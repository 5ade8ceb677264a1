"""The root `robot`."""
