"""The Gaussians of a splat scene at rest: they follow the dent, and the object is added.

In: Gaussians in their file's frame and unit, the scene as segmented, and the settled state. Out: Gaussians in the same
frame and unit, in the same order; the object's come last.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.splatting.carried import FAR, CarriedSplats, SurfaceMotion, carried, in_world
from dcap.geometry.splatting.discs import FaceColors, disc_spacing, discs_on
from dcap.scene.errors import InputError
from dcap.scene.types.choices import Anchor
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from tasks.render.settled_meshes import settled_item, settled_scene

ASKED, OPAQUE = 5000, 0.5
"""Number of Gaussians, and their least opacity, for checking that they lie on the scene's mesh."""
OFF = 0.02
"""Largest median distance of the Gaussians from the mesh, over its diagonal; above it they have another frame [-]."""
AT_ONCE = 100_000
"""Gaussians per batch [-]."""
DEVIATIONS = 2.0
"""Extent of a Gaussian over its largest standard deviation [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class SettledSplats:
    """A scene of Gaussians with the object at rest, in the scene file's frame and unit."""

    given: Gaussians
    """The input scene."""
    carried: CarriedSplats
    """The scene's Gaussians, moved with the dent."""
    floating: NDArray[np.bool_]
    """Whether Gaussians of the scene float at the object's new place and are dropped, shape (n,)."""
    item: Gaussians
    """The object's Gaussians."""

    def __len__(self) -> int:
        return len(self.given) - int(self.floating.sum()) + len(self.carried.more) + len(self.item)

    def parts(self, at_once: int = AT_ONCE) -> Iterator[Gaussians]:
        """The scene's Gaussians in their order, then the additional pieces of split ones, then the object's."""
        for first in range(0, len(self.given), at_once):
            index = np.arange(first, min(first + at_once, len(self.given)))
            part = self.carried.into(self.given.subset(index), first)
            yield part.subset(~self.floating[index])
        yield self.carried.more
        yield self.item

    @property
    def comments(self) -> tuple[str, ...]:
        """Comments for the file's header."""
        dropped, moved = int(self.floating.sum()), int((~self.floating[self.carried.index]).sum())
        return (
            "frame and unit of the scene file",
            f"{len(self.given) - dropped} Gaussians of the scene in its order; {moved} moved, {dropped} dropped",
            f"{len(self.carried.more)} further pieces of those that were split to follow the dent",
            f"{len(self.item)} Gaussians of the object",
        )


def settled_splats(
    splats: Gaussians,
    world_from_file: Array,
    scene: Segmentation,
    item: Segmentation,
    anchor: Anchor,
    settled: Settled,
    *,
    colors: FaceColors | None = None,
) -> SettledSplats:
    """The Gaussians of a file with the settled placement in them; raises InputError if they do not lie on the scene's
    mesh.

    `colors` are those of the settled object's mesh, by default the colours of its vertices.
    """
    check_on_mesh(splats, world_from_file, scene.mesh)
    after = settled_scene(scene, settled, anchor.base_id)
    thing = settled_item(item, anchor, settled.bodies[0])
    start = Mesh(after.scene.mesh.vertices - after.shift, after.scene.mesh.faces, after.scene.mesh.colors)
    movable = after.scene.face_instance == after.scene.index_of(anchor.base_id)
    found = carried(splats, world_from_file, SurfaceMotion(start, after.shift, movable))
    floating = floating_in(splats, world_from_file, thing, start)
    discs = discs_on(thing, disc_spacing(thing), colors).transformed(np.asarray(np.linalg.inv(world_from_file)))
    return SettledSplats(splats, found, floating, discs)


def check_on_mesh(splats: Gaussians, world_from_file: Array, mesh: Mesh) -> None:
    """Raise InputError for Gaussians away from the scene's mesh: two files of a folder may have different frames."""
    opaque = np.flatnonzero(splats.opacity > OPAQUE)
    some = opaque[:: -(-len(opaque) // ASKED)] if len(opaque) else opaque
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    off = (
        Raycaster(mesh).distance_to(in_world(splats.position[some], world_from_file))
        if len(some)
        else np.array([np.inf])
    )
    if float(np.median(off)) > OFF * size:
        raise InputError(
            f"the Gaussians lie {np.median(off):.2g} m from the scene's mesh in the median: not in its frame; "
            "place into the file of Gaussians alone"
        )


def floating_in(splats: Gaussians, world_from_file: Array, thing: Mesh, surface: Mesh) -> NDArray[np.bool_]:
    """Mask of the Gaussians that lie inside the object by more than their own size, and near no surface of the scene,
    shape (n,)."""
    out = np.zeros(len(splats), dtype=bool)
    unit, (low, high) = float(np.cbrt(np.linalg.det(world_from_file[:3, :3]))), thing.bounds
    inside, on_surface = MeshDistance(thing), Raycaster(surface)
    for first in range(0, len(splats), AT_ONCE):
        place = in_world(splats.position[first : first + AT_ONCE], world_from_file)
        near = np.flatnonzero(((place > low) & (place < high)).all(axis=1))
        if len(near):
            size = DEVIATIONS * unit * np.exp(splats.log_scale[first + near].max(axis=1).astype(np.float64))
            away = on_surface.distance_to(place[near]) > FAR + size
            out[first + near[away]] = inside(place[near[away]]) < -size[away]
    return out
