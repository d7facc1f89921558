"""Writers of foreign formats: meshes, splats, cameras, annotated rooms."""
