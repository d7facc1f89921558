"""Measures of a placement that need no judge: the same for every method, taken on the final meshes alone."""
