"""The gravity under which things are placed."""

GRAVITY = 9.81
"""Magnitude of gravitational acceleration [m/s^2], as in the paper's section 4.3."""
