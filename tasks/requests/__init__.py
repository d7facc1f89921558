"""Content of stages' questions for a client: views, surroundings, pictures."""
