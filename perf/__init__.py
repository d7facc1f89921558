"""What `make perf` measures: ratios within one run, so that machines can be compared."""
