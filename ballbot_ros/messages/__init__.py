"""The messages of the graph: topics, and their content from plain values; no rclpy needed."""
