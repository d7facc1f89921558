"""Sim-ready copies of a settled scene."""
