"""PX4: Skywright as its simulator, and robots as its parameters."""
