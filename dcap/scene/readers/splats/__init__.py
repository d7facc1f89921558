"""Gaussian splats and scenes of them."""
