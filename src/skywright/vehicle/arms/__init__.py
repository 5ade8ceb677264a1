"""Compliant arms: springs in their joints, position servos, hands that feel forces."""
