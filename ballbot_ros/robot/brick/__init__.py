"""The NXT brick and its devices: quantisation, schedule, packets, LCD, sound. No ROS."""
