"""Driving by hand: the input in command, and the mapping of inputs to sticks. No ROS."""
