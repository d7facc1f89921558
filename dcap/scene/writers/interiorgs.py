"""Writes a room in the InteriorGS folder layout, with a coloured SuGaR-style mesh or with Gaussian splats.

Out: labels.json (eight corners per thing in no particular order, no box for rooms and walls), structure.json,
occupancy.png/json, and `MESH_NAME` or the compressed splats. Metres, right-handed, z up. Same input, same bytes.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from dcap.scene.readers.scenes.sugar import COMPRESSED_NAME
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.floor_plan import FREE, OCCUPIED, UNKNOWN
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.gaussians import write_compressed_splats
from dcap.scene.writers.meshes import write_ply

MESH_NAME = "sugarmesh_3Dgs7000_sdfestim02_sdfnorm02_level03_decim1000000.ply"
"""SuGaR's file name of a mesh of level 0.3 decimated to a million triangles."""

OCCUPANCY_PIXELS = 1024


@dataclass(frozen=True, slots=True)
class Label:
    """An entry of labels.json."""

    id: str
    """Id; if empty, the key is left out."""
    name: str
    """Name as written, upper or lower case."""
    box: OrientedBox | None
    """Box; None for rooms and walls, which are annotated without one."""


@dataclass(frozen=True, eq=False, slots=True)
class Wall:
    """A straight wall from the floor up."""

    start: NDArray[np.float64]
    """One end of the centre line [m], shape (2,)."""
    end: NDArray[np.float64]
    thickness: float
    """Total thickness [m]."""
    height: float
    """Height [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Hole:
    """A window or door."""

    kind: str
    """WINDOW or DOOR."""
    profile: NDArray[np.float64]
    """Corners in space [m], shape (4, 3)."""
    thickness: float
    """Thickness of the wall [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class RoomRecord:
    """Content of the folder."""

    kind: str
    """Room type, such as Master Bedroom."""
    profile: NDArray[np.float64]
    """Floor polygon [m], shape (k, 2)."""
    walls: tuple[Wall, ...]
    holes: tuple[Hole, ...]
    labels: tuple[Label, ...]
    obstacles: tuple[NDArray[np.float64], ...]
    """Footprints of things on the floor [m], each (k, 2)."""
    mesh: Mesh


def write_interiorgs(folder: Path, room: RoomRecord, seed: int) -> list[Path]:
    """Write the folder with its mesh; `seed` shuffles the corners of the boxes. Returns the written files."""
    files = _write_annotations(folder, room, seed)
    write_ply(folder / MESH_NAME, room.mesh)
    return [folder / MESH_NAME, *files]


def write_interiorgs_splats(folder: Path, room: RoomRecord, splats: Gaussians, seed: int) -> list[Path]:
    """Write the same folder in InteriorGS' original form: splats, and no mesh."""
    files = _write_annotations(folder, room, seed)
    write_compressed_splats(folder / COMPRESSED_NAME, splats)
    return [folder / COMPRESSED_NAME, *files]


def _write_annotations(folder: Path, room: RoomRecord, seed: int) -> list[Path]:
    """Write everything but the surface."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    _write_json(folder / "labels.json", [_label(one, rng) for one in room.labels])
    _write_json(folder / "structure.json", _structure(room))
    _write_occupancy(folder, room)
    return [folder / name for name in ("labels.json", "structure.json", "occupancy.json", "occupancy.png")]


def _write_json(path: Path, tree: object) -> None:
    path.write_text(json.dumps(tree, indent=1) + "\n", encoding="utf-8")


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [round(float(v), 6) for v in values]


def _label(label: Label, rng: np.random.Generator) -> dict[str, object]:
    entry: dict[str, object] = {"ins_id": label.id} if label.id else {}
    entry["label"] = label.name
    if label.box is not None:
        corners = label.box.corners[rng.permutation(8)]
        entry["bounding_box"] = [dict(zip("xyz", _rounded(corner), strict=True)) for corner in corners]
    return entry


def _structure(room: RoomRecord) -> dict[str, object]:
    return {
        "rooms": [{"profile": [_rounded(p) for p in room.profile], "room_type": room.kind}],
        "walls": [
            {"location": [_rounded(w.start), _rounded(w.end)], "thickness": w.thickness, "height": w.height}
            for w in room.walls
        ],
        "holes": [
            {"profile": [_rounded(p) for p in h.profile], "thickness": h.thickness, "type": h.kind} for h in room.holes
        ],
        "ins": [
            {"label": one.name, "position": _rounded(one.box.center), "size": _rounded(np.ptp(one.box.corners, axis=0))}
            for one in room.labels
            if one.box is not None
        ],
    }


def _write_occupancy(folder: Path, room: RoomRecord) -> None:
    """Write a map whose columns run against x: x = upper_x - column * scale, y = lower_y + row * scale."""
    low, high = room.profile.min(axis=0), room.profile.max(axis=0)
    # More margin on the upper side: with an off-centre room, a reader that forgets to mirror gets unknown ground.
    lower = low - 0.3
    scale = round(float((high - lower + 0.9).max()) / OCCUPANCY_PIXELS, 6)
    upper = lower + scale * OCCUPANCY_PIXELS
    image = Image.new("L", (OCCUPANCY_PIXELS, OCCUPANCY_PIXELS), UNKNOWN)
    draw = ImageDraw.Draw(image)

    def pixels(polygon: NDArray[np.float64]) -> list[tuple[float, float]]:
        return [((upper[0] - x) / scale, (y - lower[1]) / scale) for x, y in polygon]

    draw.polygon(pixels(room.profile), fill=FREE)
    for footprint in room.obstacles:
        draw.polygon(pixels(footprint), fill=OCCUPIED)
    draw.line([*pixels(room.profile), pixels(room.profile)[0]], fill=OCCUPIED, width=max(2, int(0.1 / scale)))
    image.save(folder / "occupancy.png")
    bounds = room.mesh.bounds
    document = {
        "scale": scale,
        "center": _rounded(np.array([*(lower + upper) / 2, 0.0])),
        "upper": _rounded(np.array([*upper, bounds[1, 2]])),
        "lower": _rounded(np.array([*lower, bounds[0, 2]])),
        "min": _rounded(bounds[0]),
        "max": _rounded(bounds[1]),
    }
    _write_json(folder / "occupancy.json", document)
