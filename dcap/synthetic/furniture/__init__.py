"""Furniture built from closed solids, one file per family."""
