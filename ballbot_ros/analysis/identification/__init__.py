"""Identification: physical parameters of the robot from recordings and logs."""
