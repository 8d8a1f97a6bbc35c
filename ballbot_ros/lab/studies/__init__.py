"""Studies: many runs at once, compiled."""
