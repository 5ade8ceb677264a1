"""What a robot, a world, a mission and the plant may say: specs, loaders and data."""
