"""The document's control program: its tasks in single precision."""
