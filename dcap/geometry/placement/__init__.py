"""Where an object can be set down, and how it can stand there."""
