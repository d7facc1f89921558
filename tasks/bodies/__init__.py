"""Construction of simulated bodies, for cases and placements: from a solid and its material to the solver's model."""
