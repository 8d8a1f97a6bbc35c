"""The floor that the robot drives on: map images, walls, distances and exports."""
