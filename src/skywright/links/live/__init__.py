"""Live inputs of a real flight: poses and instruments as streams, and a player of recordings."""
