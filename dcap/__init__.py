"""Deformable, contact-aware object placement."""
