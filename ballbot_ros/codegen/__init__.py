"""The controller as C for the brick: written, compiled, run in place of the Python one. No ROS."""
