"""Measurements of `make perf`: ratios within one run, so that machines can be compared."""
