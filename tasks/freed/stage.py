"""Stage freed: start of the next drop in a scene that contains things placed earlier.

In: the scan with the record of earlier placements, the scene, the object and its anchor. Out: `FreedThings`: the
things in reach, which take part as free bodies, lifted out of their dents; the scene with those dents undone; and the
object's start above them. `freed_scene` and `freed_anchor` return scene and anchor for the later stages.

In reach are the things whose box comes near the object's start; those that rest on, carry or touch one of them; those
that lie in the same dent; and, if the object's support is dented within reach, those that dented it. Only things
carried by the same instance count: all others keep their places and their dents. A dent is elastic: the surface springs
back once the thing in it is lifted off, so the drop starts from the unloaded surface with the thing just above it, in
its rest orientation, and the thing sinks in again.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.deform import DisplacementField, with_own_vertices
from dcap.geometry.placement.clearance import Clearance
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.choices import Anchor
from dcap.scene.types.earlier import Deformation, EarlierPlacements, FreedThings
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.cache import stage

ASIDE, LEAST_ASIDE = 0.75, 0.15
"""Horizontal reach of the object from its start: over its larger horizontal side, and its least value [-, m]; its
support takes part in the drop as far."""
BELOW = 0.12
"""Vertical reach of the object [m]: deeper than any dent."""
TOUCHING = 5e-3
"""Distance within which boxes may touch as things settle again [m]."""
FELT = 1e-4
"""Displacement beyond which a surface counts as dented [m]."""
GAP = 1e-3
"""Height over the surface below at which a lifted thing starts [m]: a tenth of the object's start height."""
HIGHER = 5e-3
"""Height above all possible obstacles from which the free way down is measured [m]."""
AROUND = 0.05
"""Distance in plan beyond which nothing obstructs a thing [m]."""
DEEPEST = 0.08
"""Height above a dent from which the surface is searched [m]."""


def things_in_reach(
    scene: Segmentation, mesh: Mesh, anchor: Anchor, earlier: EarlierPlacements
) -> tuple[list[str], list[str]]:
    """Ids of the placed things that take part, and of nearby things that rest on something else.

    `mesh` is the object at its start pose.
    """
    low, high = mesh.bounds
    margin = max(ASIDE * float((high - low)[:2].max()), LEAST_ASIDE)
    away = np.array([margin, margin, BELOW])
    box = np.stack([low - away, high + away])
    ids = [one.id for one in earlier.placed]
    boxes = {one: scene.instance_mesh(scene.index_of(one)).bounds for one in ids}
    found = {one for one in ids if meet(boxes[one], box, 0.0)}
    if anchor.base_id in boxes:
        found.add(anchor.base_id)
    ground = earlier.ground_of(anchor.base_id)
    for one in earlier.deformations:
        dented = one.surface.vertices[np.linalg.norm(one.shift, axis=1) > FELT]
        if one.instance != ground or not len(dented):
            continue
        if meet(np.stack([dented.min(axis=0), dented.max(axis=0)]), box, 0.0):
            found |= set(one.loads)
    found = closed(found, earlier, boxes)
    own = [one for one in ids if one in found and earlier.ground_of(one) == ground]
    return own, [one for one in ids if one in found and one not in own]


def closed(found: set[str], earlier: EarlierPlacements, boxes: dict[str, Array]) -> set[str]:
    """The closure of a set of things: all that touch a member or lie in the same dent, and so on."""
    while True:
        more = set(found)
        for a, b in earlier.touching:
            more |= {a, b} & set(boxes) if {a, b} & found else set()
        for one in earlier.deformations:
            more |= set(one.loads) if {*one.loads, one.instance} & found else set()
        more |= {one for one in boxes if any(meet(boxes[one], boxes[other], TOUCHING) for other in found)}
        if more == found:
            return found
        found = more


def meet(one: Array, other: Array, margin: float) -> bool:
    """Return whether two boxes (2, 3) are at most a margin [m] apart along every axis."""
    return bool(((one[0] <= other[1] + margin) & (other[0] <= one[1] + margin)).all())


def unloaded(scene: Segmentation, deformations: Sequence[Deformation]) -> Segmentation:
    """The scene with the deformed surfaces in their unloaded shape."""
    vertices = scene.mesh.vertices.copy()
    for one in deformations:
        mine = np.unique(scene.mesh.faces[scene.face_instance == scene.index_of(one.instance)])
        low, high = one.surface.bounds
        near = mine[((vertices[mine] >= low - AROUND) & (vertices[mine] <= high + AROUND)).all(axis=1)]
        if len(near):
            vertices[near] -= DisplacementField(one.surface, one.shift).at(vertices[near])
    return replace(scene, mesh=replace(scene.mesh, vertices=vertices))


def lifted(scene: Segmentation, things: Sequence[str], most: float) -> tuple[Segmentation, dict[str, float]]:
    """The scene with each of the things `GAP` above everything below it, lifted from the bottom up, and the lift of
    each [m]; `most` is the largest possible depth in a dent [m]."""
    for one in things:
        scene = replace(scene, mesh=with_own_vertices(scene.mesh, scene.face_instance == scene.index_of(one)))
    vertices = scene.mesh.vertices.copy()
    heights: dict[str, float] = {}
    mesh_of = {one: scene.instance_mesh(scene.index_of(one)) for one in things}
    waiting = np.isin(scene.face_instance, [scene.index_of(one) for one in things])
    for one in bottom_up(mesh_of):
        index = scene.index_of(one)
        around = faces_around(Mesh(vertices, scene.mesh.faces, scene.mesh.colors), mesh_of[one], ~waiting)
        heights[one] = height_over(mesh_of[one], around, max(heights.values(), default=0.0) + most, GAP)
        mine = np.unique(scene.mesh.faces[scene.face_instance == index])
        vertices[mine, 2] += heights[one]
        waiting[scene.face_instance == index] = False
    return replace(scene, mesh=replace(scene.mesh, vertices=vertices)), heights


def bottom_up(mesh_of: dict[str, Mesh]) -> list[str]:
    """The things by the height of their middles: a thing comes after the thing that it lies on."""
    return sorted(mesh_of, key=lambda one: float(mesh_of[one].bounds[:, 2].mean()))


def faces_around(mesh: Mesh, thing: Mesh, allowed: NDArray[np.bool_]) -> Mesh:
    """The allowed faces (m,) that are near a thing in plan."""
    low, high = thing.bounds[0, :2] - AROUND, thing.bounds[1, :2] + AROUND
    faces = np.flatnonzero(allowed)
    corner = mesh.corners(faces)[:, :, :2]
    return mesh.submesh(faces[((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1)])


def height_over(thing: Mesh, around: Mesh, most: float, gap: float) -> float:
    """Lift that brings a thing to a gap [m] above everything below it, at most about `most` [m] more than the gap;
    never negative."""
    if not len(around.faces):
        return 0.0
    start = most + HIGHER + gap
    way = Clearance(thing, around, Raycaster(around)).gap(np.array([0.0, 0.0, start]))
    return max(start + gap - way, 0.0) if np.isfinite(way) else 0.0


def freed(scan: Scan, scene: SegmentedScene, item: SegmentedObject, anchor: Anchor) -> FreedThings:
    """Free the things in reach."""
    earlier = scan.earlier
    assert earlier is not None
    mesh = item.mesh.transformed(anchor.world_from_object)
    own, others = things_in_reach(scene, mesh, anchor, earlier)
    undone = [one for one in earlier.deformations if set(one.loads) & set(own)]
    depth = max((float(np.linalg.norm(one.shift, axis=1).max(initial=0.0)) for one in undone), default=0.0)
    start, heights = lifted(unloaded(scene, undone), own, depth)
    raised = 0.0
    if own:
        around = faces_around(start.mesh, mesh, np.ones(len(start.mesh.faces), dtype=bool))
        raised = height_over(mesh, around, max(heights.values()) + depth, anchor.clearance)
    things = [earlier.thing(one) for one in bottom_up({one: start.instance_mesh(start.index_of(one)) for one in own})]
    pose = anchor.world_from_object.copy()
    pose[2, 3] += raised
    base = Raycaster(start.instance_mesh(start.index_of(anchor.base_id)))
    hit = base.cast(anchor.surface_point[None] + [0.0, 0.0, DEEPEST], np.array([[0.0, 0.0, -1.0]]))
    point = hit.position[0] if np.isfinite(hit.distance[0]) else anchor.surface_point
    label = {one.id: one.label for one in scene.instances}
    notes = [
        f"{one} ({label[one]}), placed before, is in reach: a free body, which starts {1e3 * heights[one]:.1f} mm "
        "above where it rests"
        for one in own
    ] + [
        f"{one} ({label[one]}), placed before, is in reach but rests on something else: it stays where it is"
        for one in others
    ]
    return FreedThings(
        scene=start,
        anchor=replace(anchor, world_from_object=pose, surface_point=point),
        things=tuple(one for one in things if one is not None),
        ground=earlier.ground_of(anchor.base_id),
        materials=earlier.materials,
        notes=tuple(notes),
    )


def freed_scene(freed: FreedThings) -> SegmentedScene:
    """The scene at the start of the drop."""
    return SegmentedScene(freed.scene)


def freed_anchor(freed: FreedThings) -> Anchor:
    """The anchor at the start of the drop."""
    return freed.anchor


freed_task = stage(freed)
freed_scene_task = stage(freed_scene)
freed_anchor_task = stage(freed_anchor)
