"""Where a robot is, from files: trajectories aligned in time and frame, and fused."""
