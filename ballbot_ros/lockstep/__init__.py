"""The closed loop in one process, and the logic that the node graph shares with it. No ROS."""
