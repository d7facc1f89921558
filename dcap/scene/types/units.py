"""Units of length that files are written in."""

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Length of each unit [m], by its symbol."""
TAKEN_AS_METRES = {"centimetres": METRES["cm"], "inches": METRES["in"], "millimetres": METRES["mm"]}
"""Lengths that a file may have taken for a metre [m], by name."""
