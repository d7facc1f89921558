"""Rooms without annotations: their shell, and the things that stand or hang in it, separated by statics."""
