"""Places where an object can be set down, and poses in which it can stand there."""
