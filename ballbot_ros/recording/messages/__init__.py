"""The messages of the graph: topics and conversions from and to plain values. No rclpy."""
