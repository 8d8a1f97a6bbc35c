"""The robot as functions on numbers: arithmetic, physics, the brick and its devices, the floor."""
