"""Only for imports: no run calls it."""

sliding_window_view = None
