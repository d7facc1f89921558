"""Judges of placements, a model that looks at pictures or a rubric over metrics, and the validation of judges."""
