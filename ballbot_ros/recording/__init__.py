"""MCAP recordings: writing, reading, and messages without a graph. No ROS needed."""
