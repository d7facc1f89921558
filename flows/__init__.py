"""What a person starts: one placement, a benchmark, the command line."""
