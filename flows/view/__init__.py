"""The 3D viewer: what a placement is made of as plain arrays, and the browser page that shows it."""
