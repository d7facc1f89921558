"""Data sets: possible placement requests for a scene, their sentences, and their intended outcomes."""
