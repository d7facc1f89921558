"""Total-Lagrangian material points: the implicit step, its linear system, and the drop to rest."""
