"""The 3D viewer: robot, floor and page, live or from a file. Needs no ROS."""
