"""Stage 1, mesh: a foreign file or folder becomes one clean mesh."""
