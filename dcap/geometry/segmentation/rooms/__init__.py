"""Rooms without annotations: their shell, and what stands or hangs in it, told apart by statics."""
