"""Pictures of meshes without a display or a graphics card."""
