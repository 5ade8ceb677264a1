"""Edges to the outside, one folder or file each."""
