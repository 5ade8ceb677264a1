"""Compliant arms: joints with springs, position servos, force estimates of the hands."""
