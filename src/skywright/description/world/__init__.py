"""The root `world`."""
