"""Looks of scene and object on the page: with the faces and textures of their files, up to the page's limits.

In: results of the stages. Out: meshes with paint, and sentences on simplifications of the view.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.rendering.painted import own_paint, paint_from
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import CornerPaint, Mesh, PaintedMesh, SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from flows.view.motion import MovingObject, MovingSurfaces
from flows.view.page_textures import MOST_MOVING_PIXELS, MOST_STILL_PIXELS, fitted
from flows.view.surface import thinned
from tasks.render.settled_meshes import of_source

MOST_FACES = 600_000
"""Most faces of a scene that are drawn; in a larger one, vertices are merged [-]."""
MOST_TEXTURED = 100_000
"""Most faces of an object that is drawn with its textures [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class ShownScene:
    """A scene as it is drawn."""

    scene: Segmentation
    surface: SourceSurface
    """Its faces are those of the scene if the file has more than vertex colours; else they are not drawn."""
    notes: tuple[str, ...]

    def look(self, mesh: Mesh, origin: NDArray[np.int64]) -> PaintedMesh:
        """Look of a mesh whose faces are the faces `origin` (m,) of the scene."""
        return PaintedMesh(mesh, paint_from(self.surface, mesh, origin) if self.surface.kept else None)


def shown_scene(
    scene: Segmentation, surface: SourceSurface, anchor: Anchor | None, settled: Settled | None
) -> ShownScene:
    """The scene with its textures, or simplified to a number of faces that can be drawn, with full detail near the
    contact."""
    if surface.kept and len(surface.mesh.faces) <= MOST_FACES:
        return ShownScene(of_source(scene, surface), surface, ())
    count, notes = len(scene.mesh.faces), too_many("scene", surface)
    plain = SourceSurface.untextured()
    if count <= MOST_FACES:
        return ShownScene(scene, plain, notes)
    kept = np.zeros(count, dtype=bool)
    if anchor is not None and settled is not None:
        low, high = settled.bodies[0].surface.bounds
        margin = high - low
        corner = scene.mesh.triangles
        kept = ((corner.max(axis=1) >= low - margin) & (corner.min(axis=1) <= high + margin)).all(axis=1)
        kept &= scene.face_instance == scene.index_of(anchor.base_id)
    mesh, origin = thinned(scene.mesh, kept, MOST_FACES)
    few = replace(scene, mesh=mesh, face_instance=scene.face_instance[origin], face_part=scene.face_part[origin])
    notes += (f"the scene has {count:,} faces; {len(origin):,} are shown, the result used all of them",)
    return ShownScene(few, plain, notes)


def shown_object(item: Segmentation, surface: SourceSurface, anchor: Anchor) -> tuple[PaintedMesh, tuple[str, ...]]:
    """The object in its pose before the drop, and notes on its look."""
    if surface.kept and len(surface.mesh.faces) <= MOST_TEXTURED:
        return PaintedMesh(surface.mesh.transformed(anchor.world_from_object), own_paint(surface)), ()
    return PaintedMesh(item.mesh.transformed(anchor.world_from_object)), too_many("object", surface)


def too_many(what: str, surface: SourceSurface) -> tuple[str, ...]:
    """Note for a textured surface that is shown without its textures."""
    if not surface.kept:
        return ()
    count = len(surface.mesh.faces)
    return (f"the {what} has {count:,} textured faces: it is shown without textures, in the colours of its vertices",)


@dataclass(frozen=True, eq=False, slots=True)
class FittedTextures:
    """Paints of everything that is drawn, reduced to the page's budget of pixels."""

    pieces: tuple[CornerPaint | None, ...]
    thing: CornerPaint | None
    bending: dict[tuple[int, int], CornerPaint | None]
    notes: tuple[str, ...]


def fitted_textures(
    pieces: Sequence[CornerPaint | None], thing: MovingObject | None, bending: MovingSurfaces | None, frames: int
) -> FittedTextures:
    """Textures of the still parts of the room, of the object, and of bending faces, which have an image for every
    frame."""
    own, dents = thing.start.paint if thing else None, bending.paints if bending else {}
    deforms = thing is not None and thing.deforms
    twice = [] if deforms else [own, own]  # one more for the pose before the drop
    still = fitted([*pieces, *twice], 1, MOST_STILL_PIXELS)
    moving = fitted([*dents.values(), *([own] if deforms else [])], frames, MOST_MOVING_PIXELS)
    reduced = still.reduced + moving.reduced
    side = max(still.largest, moving.largest)
    note = f"{reduced} textures are shown with fewer pixels than they have, at most {side} a side"
    last = (moving if deforms else still).paints[-1] if thing else None
    bent = dict(zip(dents, moving.paints, strict=False))
    return FittedTextures(still.paints[: len(pieces)], last, bent, (note,) if reduced else ())
