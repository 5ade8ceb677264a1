"""A plant that an autopilot flies: its rotors are the autopilot's, its sensors are read out."""
