"""Stage 2, segment: instances and their named parts."""
