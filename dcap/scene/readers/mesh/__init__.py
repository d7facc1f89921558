"""Meshes of one format each, and their colours."""
