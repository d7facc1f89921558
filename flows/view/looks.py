"""Looks of scene and object on the page: the faces and textures of their files, within the page's limits.

In: results of the stages. Out: meshes with paint, and sentences on simplifications of the view.

Textures for the page: cropped to the part that a surface shows, and scaled down to a budget.

Every node of the page has images of its own. Each is cropped to the part that its faces use, and the largest ones are
scaled down until all together are within the budget.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.geometry.rendering.painted import own_paint, paint_from
from dcap.scene.srgb import CLAMP, MIRROR, REPEAT
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import CornerPaint, Mesh, PaintedMesh, SourceSurface, SurfaceMaterial
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from flows.view.surface import MovingObject, MovingSurfaces, thinned
from tasks.render.settled_meshes import of_source

LARGEST_SIDE = 2048
"""Largest side of an image [pixel]."""
MOST_STILL_PIXELS, MOST_MOVING_PIXELS = 2**24, 2**23
"""Most pixels in all images of rigid surfaces, and of surfaces with a shape for every frame [-]."""
LEAST = 16
"""Least pixels that an image keeps [-]."""
MOST_FACES = 600_000
"""Most faces of a scene that are drawn; in a larger one, vertices are merged [-]."""
MOST_TEXTURED = 100_000
"""Most faces of an object that is drawn with its textures [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class PageTextures:
    """Paints within the budget."""

    paints: tuple[CornerPaint | None, ...]
    reduced: int
    """Number of images that were scaled down [-]."""
    largest: int
    """Longest side of these images [pixel]."""


def fitted(paints: Sequence[CornerPaint | None], copies: int, most: int) -> PageTextures:
    """Paints of several surfaces, sent `copies` times each, scaled down to at most `most` pixels in total."""
    cut = [None if one is None else trimmed(one) for one in paints]
    used = [(one, slot) for one in cut if one is not None for slot in slots(one)]
    sizes = np.array([np.prod(one.textures[slot].shape[:2]) for one, slot in used], dtype=np.float64)
    cap = largest_share(np.minimum(sizes, LARGEST_SIDE**2), most / max(copies, 1))
    reduced, largest = 0, 0
    for number, one in enumerate(cut):
        if one is None:
            continue
        images = list(one.textures)
        for slot in slots(one):
            before = images[slot].shape[:2]
            images[slot] = smaller(images[slot], cap)
            if images[slot].shape[:2] != before:
                reduced, largest = reduced + 1, max(largest, *images[slot].shape[:2])
        cut[number] = replace(one, textures=tuple(images))
    return PageTextures(tuple(cut), reduced, largest)


def slots(paint: CornerPaint) -> list[int]:
    """Textures that faces use."""
    return [int(one) for one in np.unique(paint.texture[paint.texture >= 0])]


def largest_share(sizes: NDArray[np.float64], most: float) -> float:
    """Limit to cut the largest of some numbers to, so that their sum is at most `most`."""
    rest = most
    for count, one in zip(range(len(sizes), 0, -1), np.sort(sizes), strict=True):
        if one * count > rest:
            return max(rest / count, LEAST)
        rest -= float(one)
    return float("inf")


def smaller(image: NDArray[np.uint8], most: float) -> NDArray[np.uint8]:
    """An image with at most so many pixels, and sides that the page can take."""
    height, width = image.shape[:2]
    factor = min(1.0, float(np.sqrt(most / (height * width))), LARGEST_SIDE / max(height, width))
    if factor >= 1.0:
        return image
    size = max(1, int(width * factor)), max(1, int(height * factor))
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))


def trimmed(paint: CornerPaint) -> CornerPaint:
    """A paint whose textures are cropped to the part that its faces show; further maps are left out."""
    paint = replace(paint, materials=tuple(map(plain_light, paint.materials)), more_uv=())
    images, wraps, uv = list(paint.textures), [paint.wrap(one) for one in range(len(paint.textures))], paint.corner_uv
    uv = uv.copy()
    for slot in slots(paint):
        mine = paint.texture == slot
        u, v = paint.corner_uv[mine].astype(np.float64).transpose(2, 0, 1)
        height, width = images[slot].shape[:2]
        columns, rows = span(u, width, wraps[slot][0]), span(1.0 - v, height, wraps[slot][1])
        if columns is not None:
            u = (u * width - columns[0]) / (columns[1] - columns[0])
        if rows is not None:
            v = 1.0 - ((1.0 - v) * height - rows[0]) / (rows[1] - rows[0])
        for axis, found in ((1, columns), (0, rows)):
            if found is not None:
                index = pixels(np.arange(*found), images[slot].shape[axis], wraps[slot][1 - axis])
                images[slot] = np.take(images[slot], index, axis=axis)
        wraps[slot] = (wraps[slot][0] if columns is None else CLAMP, wraps[slot][1] if rows is None else CLAMP)
        uv[mine] = np.stack([u, v], axis=2)
    return replace(paint, textures=tuple(images), wraps=tuple(wraps), corner_uv=uv)


def plain_light(said: SurfaceMaterial) -> SurfaceMaterial:
    """A material without further maps: the page shows the base colour and uniform gloss."""
    emission = said.emission if said.emissive_map is None else (0.0, 0.0, 0.0)
    return replace(
        said, emission=emission, metallic_roughness_map=None, normal_map=None, occlusion_map=None, emissive_map=None
    )


def span(places: NDArray[np.float64], count: int, wrap: str) -> tuple[int, int] | None:
    """First pixel and the one after the last that coordinates reach; None if they reach all."""
    low, high = int(np.floor(places.min() * count)) - 1, int(np.ceil(places.max() * count)) + 1
    if wrap == CLAMP:
        low, high = min(max(low, 0), count - 1), max(min(high, count), 1)
    return (low, high) if high - low < count else None


def pixels(index: NDArray[np.int64], count: int, wrap: str) -> NDArray[np.int64]:
    """Indices inside the image for pixels beyond its border."""
    if wrap == REPEAT:
        return index % count
    if wrap == MIRROR:
        return np.where(index % (2 * count) < count, index % count, count - 1 - index % count)
    return np.clip(index, 0, count - 1)


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
