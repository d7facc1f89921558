"""Units and axes: from a file's coordinates to metres and z up."""
