"""Thin rclpy nodes, one file each, and the conversions between messages and plain values."""
