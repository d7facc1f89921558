"""The explicit method: MLS-MPM with a graded grid for each soft body; bodies interact at their surfaces."""
