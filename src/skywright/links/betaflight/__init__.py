"""Betaflight in software in the loop: Skywright is its simulator and its pilot."""
