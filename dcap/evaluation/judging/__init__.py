"""Who judges placements, a model that looks at pictures or a rubric over metrics, and how good a judge is."""
