"""A quasi-static contact solver for soft and rigid bodies: arrays in, arrays out, without imports from the rest of this
project."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # its greeting would go to standard output, among results
