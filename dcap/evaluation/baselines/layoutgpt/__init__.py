"""LayoutGPT (Feng et al., 2023): a model writes the layout of a room as CSS lines, after those of similar rooms.

The source is its paper and its published program for rooms in three dimensions (run_layoutgpt_3d.py,
parse_llm_output.py). Theirs: the form of a line and what its numbers mean (the middle of the box from the plan's least
corner, pixels of a 256th of the room's shorter side, cut to integers), the choice of K = 8 exemplars by the mean
squared difference of 64 x 64 pictures of the floor, the nearest first, their limit of length, the parser that drops
invalid lines, and that nothing is repaired or simulated. Ours, because it places one asset in a given room: the
room's own things are lines already, with lines for their parts too, so that a seat can be told from a backrest; a
sentence says what is wanted and exactly one new line is asked for; its size gives way to the asset's own; orientation 0
looks along -y; `top` grows along +y; heights are counted from the floor.
"""
