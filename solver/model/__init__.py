"""The constant and the changing part of a simulation: bodies, soft system, state."""
