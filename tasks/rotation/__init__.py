"""Stage 4, rotation: orientation of the object."""
