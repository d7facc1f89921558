"""Gaussian splats rendered and converted to surface points, in Taichi, which the caller must have started."""
