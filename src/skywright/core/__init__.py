"""Records, units, rotations, draws, TOML and finding what is asked for by name."""
