"""Procedural furniture, objects and furnished rooms, reproducible from a seed."""
