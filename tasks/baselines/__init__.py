"""Stages of other placement methods. In: a scene, an object and the shared part of the intent. Out: a final pose."""
