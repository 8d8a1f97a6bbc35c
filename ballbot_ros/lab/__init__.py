"""Many runs at once: studies, and environments for learning."""
