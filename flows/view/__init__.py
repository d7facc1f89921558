"""The 3D viewer: a placement as plain arrays, and the browser page that shows it."""
