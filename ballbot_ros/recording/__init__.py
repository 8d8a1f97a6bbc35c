"""MCAP recordings: writing, reading, and messages without a graph. Nothing here needs ROS."""
