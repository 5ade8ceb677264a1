"""ROS 2 without a ROS installation: the key expressions and tokens of rmw_zenoh, over Zenoh."""
