"""Effects: forces on the plant in addition to those of its rotors and servos."""
