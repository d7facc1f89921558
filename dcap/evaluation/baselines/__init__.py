"""Other methods of placing an object, built from what their authors published: same inputs and outputs as ours."""
