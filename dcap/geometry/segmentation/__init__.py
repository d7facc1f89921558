"""Instances and named parts of a mesh by shape, colour, annotated boxes and node names."""
