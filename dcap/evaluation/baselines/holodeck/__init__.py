"""Holodeck (Yang et al., 2024): a model names relations, and a search over a grid finds a place that meets them.

The source is its paper and its published program (floor_objects.py, small_objects.py, prompts.py). Theirs: the
vocabulary of relations and the form of a line, its parser, the depth-first search on the floor with its scores, and the
random places on a receptacle for things that stand on it. Ours, because it places one asset in a given room: the room's
things are placed already and can be named in relations; rays against the scene replace its simulator AI2-THOR, which
tries places on a receptacle (see `receptacle.py`); physics does not move places afterwards.
"""
