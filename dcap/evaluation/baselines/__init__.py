"""Other methods of placement, with the same inputs and outputs as ours: what they propose is measured as it stands."""
