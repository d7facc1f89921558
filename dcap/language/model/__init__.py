"""Clients that get their answers from a model, live or recorded."""
