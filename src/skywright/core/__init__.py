"""Records, units, rotations, random streams, TOML files, and finding classes by name."""
