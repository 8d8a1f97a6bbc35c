"""A run as an object: its specification, the ways of running it, and its result."""
