"""The independent referee: checks a rest state with a rigid-body engine and a geometry library that are not ours."""
