"""The closed loop in one process, and what the node graph shares with it. No ROS."""
