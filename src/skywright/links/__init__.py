"""Interfaces to other programs and devices, one folder or file each."""
