"""Readers of foreign scenes and meshes: each checks its file at the border and hands back one `RawMesh`."""
