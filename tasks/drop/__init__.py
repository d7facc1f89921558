"""Stage 8, drop: the object comes to rest."""
