"""Measures of a final state that need no judge, the same for every method."""
