"""Metrics, figures, reports, comparisons and replays of recorded runs. No ROS."""
