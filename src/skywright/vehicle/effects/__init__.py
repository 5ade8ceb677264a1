"""Effects: forces on the plant besides its rotors and servos."""
