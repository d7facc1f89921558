"""Pure algorithms on meshes and points."""
