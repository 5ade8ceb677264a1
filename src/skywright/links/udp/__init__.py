"""The UDP gateway: packets, their reception, both ends of a connection."""
