"""What `make perf-peers` measures: the reference drops in other simulators, each in a process of its own."""
