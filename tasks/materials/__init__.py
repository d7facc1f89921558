"""Stage 6, materials: a row of the library for each part."""
