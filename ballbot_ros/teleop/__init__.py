"""Driving by hand: who is in command, and what each input makes of the sticks. No ROS."""
