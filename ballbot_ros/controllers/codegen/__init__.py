"""The controller as C for the brick: generation, compilation, and running it. No ROS."""
