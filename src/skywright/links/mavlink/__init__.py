"""MAVLink: packets of a byte stream, and messages to bytes."""
