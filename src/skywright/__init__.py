"""Skywright."""
