"""Objects to place, built from closed solids, one file per family."""
