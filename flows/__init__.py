"""Entry points for people: one placement, a benchmark, the command line."""
