"""A flight told to others while it is flown: the messages that ROS 2 and Foxglove get."""
