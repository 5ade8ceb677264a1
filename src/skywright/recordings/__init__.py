"""Recordings: what they hold, and the MCAP files with ROS 2 messages that carry it."""
