"""Estimators of the robot's state: a module each, with one class."""
