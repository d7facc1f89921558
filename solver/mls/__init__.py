"""The explicit method: MLS-MPM with a graded grid for each soft body, which meet at their surfaces."""
