"""Scenarios: start state, stick signals, pushes and expected outcome. No ROS."""
