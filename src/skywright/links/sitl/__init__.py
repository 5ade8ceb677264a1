"""A plant for an autopilot: the autopilot commands the rotors and receives the sensors."""
