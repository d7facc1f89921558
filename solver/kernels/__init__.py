"""Taichi kernels on plain arrays; each is deterministic for any number of threads (nodes gather, nothing is added
atomically)."""
