"""Other methods of placing an object, built from what their authors published: same inputs and outputs as ours."""
"""Other methods of placement, with the same inputs and outputs as ours: what they propose is measured as it stands."""
