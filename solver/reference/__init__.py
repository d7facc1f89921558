"""Slow float64 numpy twins of the kernels, written from the sources; tests compare the two."""
