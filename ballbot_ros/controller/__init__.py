"""The control program of the brick: its tasks in single precision. No ROS."""
