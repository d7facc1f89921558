"""Settings from `dcap.yaml` and the environment: what was given where, and what it comes to."""
