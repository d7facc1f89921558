"""A quasi-static contact solver for soft and rigid bodies: arrays in, arrays out; imports nothing else of this
project."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # when imported it greets on standard output: results go there
