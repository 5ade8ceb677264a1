"""Live publication of a flight: the messages for ROS 2 and Foxglove."""
