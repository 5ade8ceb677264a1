"""Robots described for other tools (MJCF, URDF, SDF), written as robot files of Skywright."""
