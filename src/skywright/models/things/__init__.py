"""Kinds of things in a world, one file each; `core.find` finds them by their name."""
