"""Settings in force: options of commands, settings of stages, and where each value came from."""
