"""Readers of foreign scenes and meshes: each validates its file and returns one `RawMesh`."""
