"""Controller design on python-control: servo LQR and margins. No ROS."""
