"""Checks of a whole dataset: every problem of every file, by path and line."""
