"""Stage 7, particles: the bodies of the drop."""
