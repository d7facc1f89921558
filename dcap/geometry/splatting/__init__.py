"""Gaussian splats rendered and turned into points of a surface, in Taichi; whoever calls has started it."""
