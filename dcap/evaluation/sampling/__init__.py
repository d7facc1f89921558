"""Data sets: which placements may be asked of a scene, in which words, and what should come of them."""
