"""The 3D viewer of runs, live or recorded: robot, floor and page. No ROS."""
