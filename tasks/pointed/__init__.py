"""Turns a point or a box in the scene file's own frame into the thing that carries."""
