"""The paper's method: explicit MLS-MPM on a uniform grid, with rigid bodies coupled at its nodes."""
