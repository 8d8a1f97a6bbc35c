"""Controller design on python-control: servo LQR, pole placement, margins. No ROS."""
