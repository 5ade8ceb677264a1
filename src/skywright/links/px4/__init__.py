"""PX4: Skywright as its simulator, and a robot as its parameters."""
