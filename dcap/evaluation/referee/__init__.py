"""The independent referee: what a rigid-body engine and a geometry library that are not ours say of a rest state."""
