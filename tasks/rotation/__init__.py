"""Stage 4, rotation: how the object is turned."""
