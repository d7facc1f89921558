"""Stage 5, anchor: the part and the place on it."""
