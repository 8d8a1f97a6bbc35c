"""Thin rclpy nodes, one file each, and what they share."""
