"""Recordings: columns and topics, stored in MCAP files as ROS 2 messages."""
