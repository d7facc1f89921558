"""Measurements of `make perf-peers`: the reference drops in other simulators, each in a process of its own."""
