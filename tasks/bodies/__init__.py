"""What cases and placements share in building bodies: footprints and background grids."""
