"""Control programs of the brick: the interface, and the programs. No ROS."""
