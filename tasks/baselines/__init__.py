"""Stages of other methods of placement: a scene, an object and what all methods share in, a final pose out."""
