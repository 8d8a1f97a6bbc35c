"""Runs as objects: specification, execution, and result."""
