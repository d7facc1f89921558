"""How simulated bodies are built, for cases and for placements: from a solid and its material to the solver's model."""
