"""Evaluation of placements: regions, tables and reports."""
