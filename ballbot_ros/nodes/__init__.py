"""Thin rclpy nodes, one file each, and the code that they share."""
