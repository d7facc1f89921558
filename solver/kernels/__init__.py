"""Taichi kernels on plain arrays; each is deterministic for any number of threads (nodes gather, nothing is added
atomically)."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # standard output belongs to results
