"""The stages: one module each, pure functions made into cached tasks."""
