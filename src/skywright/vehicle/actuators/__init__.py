"""Actuators: what the robot's commands move in the plant."""
