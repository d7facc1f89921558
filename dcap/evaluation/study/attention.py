"""Attention checks: a placement next to a copy of it in which the object is lifted and floats.

In: the placement's scene.glb (world frame: metres, z up). Out: for each check the folders `attention/01/settled` and
`attention/01/lifted` with pictures and a smaller GLB file, cut out around the object. Both come from the same scene.glb
and differ only in the object's height. Names and sizes of the pictures equal those of the placement, so they do not
reveal a check.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.evaluation.outcome_table import AT_REST
from dcap.evaluation.study.design import ShownPlacement, StudyRun
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.painted import own_paint
from dcap.geometry.rendering.surface import ShadingNormals
from dcap.scene.errors import DcapError, FormatError
from dcap.scene.readers.gltf.gltf import read_gltf
from dcap.scene.types.mesh import CornerPaint, Mesh, SourceSurface
from dcap.scene.writers.glb import GLTF_FROM_WORLD, Node, glb_bytes
from dcap.scene.written_files import whole_file, write_whole

THING = "object"
"""The node of the object at rest."""
AROUND, LEAST_AROUND = 2.0, 0.9
"""Extent of the surroundings kept around the object: in sizes of the object [-], and at least [m]."""
MOST_FACES = 300_000
"""Most faces of a cut-out [-]: a browser draws two of them side by side, and both files are sent at once."""
SHRINK = 0.8
"""Factor by which a larger cut-out shrinks in each step [-]."""
AZIMUTHS, ELEVATION_DEG = 12, 28.0
"""Number of directions that are tried around the object, and their elevation [degrees]."""
RAYS = 300
"""Number of rays to points of the object from each direction [-]."""
BACK = 2.6
"""Viewing distance, in diagonals of the object [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacedSurface:
    """Final scene and object with their textures."""

    mesh: Mesh
    paint: CornerPaint | None
    is_thing: NDArray[np.bool_]
    """Whether each face is the object's, shape (m,)."""
    ids: tuple[str, ...]
    """Ids of the things of the scene."""
    face_id: NDArray[np.int32]
    """Index into `ids` per face, -1 for the object's, shape (m,)."""

    @property
    def thing_bounds(self) -> NDArray[np.float64]:
        """Bounds of the object [m], shape (2, 3)."""
        return self.mesh.submesh(np.flatnonzero(self.is_thing)).bounds

    def of(self, faces: NDArray[np.integer]) -> Self:
        """The surface of some faces."""
        paint = None if self.paint is None else self.paint.of(faces)
        return replace(
            self, mesh=self.mesh.submesh(faces), paint=paint, is_thing=self.is_thing[faces], face_id=self.face_id[faces]
        )

    def around_thing(self, most_faces: int = MOST_FACES) -> Self:
        """The object and its surroundings, reduced to `most_faces`."""
        low, high = self.thing_bounds
        reach = max(AROUND * float(np.linalg.norm(high - low)), LEAST_AROUND)
        triangles = self.mesh.triangles
        least, most = triangles.min(axis=1), triangles.max(axis=1)
        while True:
            near = ((most >= low - reach) & (least <= high + reach)).all(axis=1) | self.is_thing
            if np.count_nonzero(near) <= most_faces or reach < 0.05:
                return self.of(np.flatnonzero(near))
            reach *= SHRINK

    def lifted(self, height: float) -> Self:
        """The surface with only the object raised [m]."""
        shift = np.zeros_like(self.mesh.vertices)
        shift[np.unique(self.mesh.faces[self.is_thing])] = (0.0, 0.0, height)
        return replace(self, mesh=replace(self.mesh, vertices=self.mesh.vertices + shift))

    def glb(self, toward: NDArray[np.float64]) -> bytes:
        """The surface as a GLB file for the page; `toward` (3,) is the direction to look from, kept in the object's
        extras."""
        normals = ShadingNormals(self.mesh).of_corners(np.arange(len(self.mesh.faces)))
        nodes = []
        for name, own in (("scene", ~self.is_thing), (THING, self.is_thing)):
            faces = np.flatnonzero(own)
            paint = None if self.paint is None else self.paint.of(faces)
            extras = {"toward": [round(float(x), 6) for x in toward]} if name == THING else {}
            nodes.append(Node(name, self.mesh.submesh(faces), paint=paint, normals=normals[faces], extras=extras))
        return glb_bytes(nodes)

    def best_direction(self) -> NDArray[np.float64]:
        """Unit direction from the object to the camera that sees most of it, shape (3,)."""
        low, high = self.thing_bounds
        size, middle = float(np.linalg.norm(high - low)), (low + high) / 2
        thing = np.flatnonzero(self.is_thing)
        points = self.mesh.corners(thing[np.linspace(0, len(thing) - 1, RAYS).astype(int)]).mean(axis=1)
        caster = Raycaster(self.mesh)
        shares = []
        for direction in directions():
            way = middle + BACK * size * direction - points
            length = np.linalg.norm(way, axis=1)
            unit = way / length[:, None]
            start = points + 1e-3 * size * unit
            shares.append(1.0 - caster.occluded(start, unit, length).mean())
        return np.asarray(directions()[int(np.argmax(shares))])


def directions() -> NDArray[np.float64]:
    """Unit directions around the vertical axis, from a little above, shape (n, 3)."""
    azimuth = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    flat, height = np.cos(np.radians(ELEVATION_DEG)), np.sin(np.radians(ELEVATION_DEG))
    return np.stack([flat * np.sin(azimuth), -flat * np.cos(azimuth), np.full(AZIMUTHS, height)], axis=1)


def read_placed_surface(path: Path) -> PlacedSurface:
    """The surface in scene.glb; FormatError where it has no node `object`."""
    raw = read_gltf(path)
    own = np.array([name == THING or name.startswith(f"{THING}/") for name in raw.node_names] + [False])
    is_thing = own[raw.face_node]
    if not is_thing.any():
        raise FormatError(f"{path}: no node {THING!r} with faces")
    colors = np.full(raw.vertices.shape, 255, np.uint8) if raw.colors is None else raw.colors
    mesh = Mesh(np.ascontiguousarray(raw.vertices), raw.faces.astype(np.int32), colors)
    world = mesh.transformed(np.linalg.inv(GLTF_FROM_WORLD))
    textured = raw.paint is not None and len(raw.paint.textures) > 0
    paint = own_paint(SourceSurface(mesh, raw.paint)) if textured and raw.paint is not None else None
    owners = [None if name == THING else name.split("/")[0] for name in raw.node_names]
    ids = tuple(dict.fromkeys(one for one in owners if one is not None))
    number_of = np.array([*(-1 if one is None else ids.index(one) for one in owners), -1], dtype=np.int32)
    return PlacedSurface(world, paint, is_thing, ids, np.where(is_thing, -1, number_of[raw.face_node]))


ATTENTION, SETTLED, LIFTED, MODEL = "attention", "settled", "lifted", "model.glb"
MOST_CHECKS = 3
"""Number of different checks of a study [-]; raters may see one more than once."""
LIFT, LEAST_LIFT = 0.7, 0.12
"""Height at which the copy floats: in heights of the object [-], and at least [m]."""

CheckPictures = Callable[[ShownPlacement, PlacedSurface, PlacedSurface], Mapping[str, NDArray[np.uint8]]]
"""Takes the pictures of one side of a check, by name, from a placement, its surface at rest, and the side's surface."""


def make_checks(
    run: StudyRun, folder: Path, seed: int, take: CheckPictures, say: Callable[[str], None]
) -> tuple[tuple[str, str], ...]:
    """Make the checks of a study. Returns (method, sample) of each; `say` reports placements that allow none."""
    found: list[tuple[str, str]] = []
    for method, sample in candidates(run, seed):
        if len(found) == MOST_CHECKS:
            break
        try:
            write_check(run.shown[method, sample], check_folder(folder, len(found) + 1), take)
            found.append((method, sample))
        except DcapError as error:
            say(f"no attention check of {method} {sample}: {error}")
    return tuple(found)


def candidates(run: StudyRun, seed: int) -> list[tuple[str, str]]:
    """Placements of different samples for floating copies; those at rest come first."""
    resting = [key for key, one in run.shown.items() if one.scene_model is not None and one.verdict == AT_REST]
    usable = resting or [key for key, one in run.shown.items() if one.scene_model is not None]
    first = {sample: (method, sample) for method, sample in reversed(usable)}  # from the run's first method that has it
    order = sorted(first)
    Random(f"{seed} attention").shuffle(order)
    return [first[sample] for sample in order]


def check_folder(study: Path, number: int, name: str = "") -> Path:
    """Folder of a check, from 1, or of one side of it."""
    return study / ATTENTION / f"{number:02d}" / name


def write_check(placement: ShownPlacement, folder: Path, take: CheckPictures) -> None:
    """Pictures and models of a placement that has a scene.glb, and of its floating copy."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    low, high = surface.thing_bounds
    rise = max(LIFT * float(high[2] - low[2]), LEAST_LIFT)
    near = surface.around_thing()
    toward = near.best_direction()
    for name, height in ((SETTLED, 0.0), (LIFTED, rise)):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for view, rgb in take(placement, surface, surface.lifted(height)).items():
            with whole_file(folder / name / f"{view}.png") as draft:
                Image.fromarray(rgb).save(draft)
        write_whole(folder / name / MODEL, near.lifted(height).glb(toward))
