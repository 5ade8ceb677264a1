"""Actuators: apply the robot's commands to the plant."""
