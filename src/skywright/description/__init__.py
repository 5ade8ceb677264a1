"""Descriptions of robot, world, mission and plant: specs, loaders and data."""
