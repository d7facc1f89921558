"""A data set of a desk in a room: what is put on it is rigid on rigid, the cheapest drops."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from tiny_rooms import solid, table

from dcap.scene.writers.glb import Node, glb_bytes


def desk_dataset(folder: Path, prompts: Mapping[str, str]) -> Path:
    """The data set's file, with a sample for each id: `book` puts a book, any other a mug."""
    parts = [Node(name, solid(tuple(np.add((1.0, 1.0, 0.0), low)), size)) for name, low, size in table(1.4, 0.7, 0.74)]
    floor = Node("floor_0", label="floor", children=(Node("floor", solid((0, 0, -0.05), (4, 4, 0.05))),))
    (folder / "room.glb").write_bytes(glb_bytes([floor, Node("desk_1", label="desk", children=tuple(parts))]))
    (folder / "mug.glb").write_bytes(glb_bytes([Node("mug", solid((-0.04, -0.04, 0), (0.08, 0.08, 0.1)))]))
    (folder / "book.glb").write_bytes(glb_bytes([Node("book", solid((-0.08, -0.11, 0), (0.16, 0.22, 0.03)))]))
    rows = [
        f"- {{id: {name}, scene: room.glb, object: {'book' if name == 'book' else 'mug'}.glb, prompt: {prompt}}}\n"
        for name, prompt in prompts.items()
    ]
    (folder / "set.yaml").write_text("".join(rows))
    return folder / "set.yaml"
