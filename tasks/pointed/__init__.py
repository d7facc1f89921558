"""What a person points at, a point or a box of the scene file's own frame, becomes the thing that carries."""
