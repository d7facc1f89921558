"""Stages point and point_out: a point or a box in the scene file's own frame determines the object's support.

In: the scan (for the file's frame), the scene, the sentence and the point or box. Out: `Pointed`; then the scene in
which the indicated thing is a separate instance, if it was not one before: the faces in the box, or the surface around
the point with the faces below it. The sentence names it if the scene's label is uncertain; a mismatch is reported.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from dcap.geometry.segmentation.faces import FaceTable, surface_pieces
from dcap.geometry.segmentation.parts.rules import make_instance
from dcap.scene.errors import InputError
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.pointed import Pointed
from dcap.scene.types.rectangle import min_area_box
from dcap.scene.types.sample import GivenPlace
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Instance, Part, Segmentation, SegmentedScene
from tasks.cache import stage
from tasks.pointed.naming import SURE, Name, asked_thing, carrying_part, name_of
from tasks.pointed.surface import ABOVE, LEVEL, in_file, in_words, level_axes, meeting

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

WHOLE = 0.9
"""Share of a thing's surface in a box, or in a surface, from which the whole thing is meant [-]."""
MOSTLY = 0.8
"""Least share of the upward surface in the box that belongs to that thing [-]."""
FUSED = 3.0
"""Area in plan over that of the indicated surface above which a thing is more than the support [-]."""
TALL = 1.3
"""Height over the indicated surface above which a thing contains a wall [m]."""
BAND = 0.15
"""Largest height difference of the indicated surface from the point [m]: cushions, dents, noise."""
RIM = 0.06
"""Distance beyond the surface's outline within which faces below belong to it [m]: fronts, edges."""
LEAST_AREA = 1e-4
"""Least upward surface that carries anything [m^2]."""


def point(scan: Scan, scene: SegmentedScene, place: GivenPlace, prompt: str) -> Pointed:
    """The indicated thing; InputError with the value and the scene's bounds if nothing carries there."""
    return at_point(scan, scene, place.at, prompt) if place.at else in_box(scan, scene, place.support, prompt)


def point_out(scene: SegmentedScene, pointed: Pointed) -> SegmentedScene:
    """The scene in which the indicated thing is one instance with its name."""
    if len(pointed.cut):
        return SegmentedScene(with_new_thing(scene, pointed))
    return SegmentedScene(with_new_name(scene, pointed)) if pointed.renamed else scene


point_task = stage(point)
point_out_task = stage(point_out)


# a point ------------------------------------------------------------------------------------------------------------


def at_point(scan: Scan, scene: Segmentation, at: tuple[float, ...], prompt: str) -> Pointed:
    """The thing whose surface is nearest below the point."""
    met = meeting(scan, scene, at)
    owner = int(scene.face_instance[met.face])
    notes = []
    if len(at) == 2:
        first, second = level_axes(scan)
        own = in_file(scan, met.position[None])[0]
        notes.append(f"--at: the highest surface at {'xyz'[first]} {at[0]:g}, {'xyz'[second]} {at[1]:g} is at "
                     f"{','.join(f'{one:.4g}' for one in own)}")  # fmt: skip
    else:
        given = scan.world_from_file[:3, :3] @ np.array(at) + scan.world_from_file[:3, 3]
        if given[2] - met.position[2] > ABOVE:
            above = f"--at is {given[2] - met.position[2]:.2f} m above what is below it; the object goes down there"
            notes.append(Caution(Cause.NOT_MET, above))
    if owner < 0:
        patch = patch_at(scene, met.face, met.position)
        return cut_out(scene, patch, Name("thing", renamed=False), None, met.position, notes)
    one = scene.instances[owner]
    name = name_of(one, asked_thing(prompt), "--at")
    notes += name.notes
    if one.structure or one.confidence >= SURE:
        return Pointed(one.id, name.label, "", met.position, none(), False, tuple(notes))
    patch = patch_at(scene, met.face, met.position)
    mine = scene.face_instance == owner
    box = min_area_box(scene.mesh.corners(patch).reshape(-1, 3))
    plans = [float(np.prod(each.half_extents[:2])) for each in (one.box, box)]
    if plans[0] > FUSED * plans[1] or one.box.top - met.position[2] > TALL:
        below = under(scene, patch, mine)
        if scene.mesh.face_areas[below].sum() < WHOLE * scene.mesh.face_areas[mine].sum():
            return cut_out(scene, below, name, one, met.position, notes)
    return Pointed(one.id, name.label, "", met.position, none(), name.renamed, tuple(notes))


def patch_at(scene: Segmentation, face: int, position: Array) -> Index:
    """The connected upward faces of similar height around a face, within the same instance."""
    center, normal = scene.mesh.triangles.mean(axis=1), scene.mesh.face_normals
    up = normal[:, 2] > LEVEL * np.linalg.norm(normal, axis=1)
    near = up & (np.abs(center[:, 2] - position[2]) < BAND) & (scene.face_instance == scene.face_instance[face])
    near[face] = True
    faces = np.flatnonzero(near)
    region = surface_pieces(scene.mesh, faces)
    return np.asarray(faces[region == region[np.searchsorted(faces, face)]])


def under(scene: Segmentation, patch: Index, mine: Mask) -> Index:
    """A surface with the faces of its thing below it: fronts and sides that hold it up."""
    center = scene.mesh.triangles.mean(axis=1)
    top = float(scene.mesh.corners(patch)[..., 2].max())
    faces = np.flatnonzero(mine & (center[:, 2] < top + 1e-3))
    points = scene.mesh.corners(patch).reshape(-1, 3)[:, :2]
    middle = points.mean(axis=0)
    spread = np.linalg.norm(points - middle, axis=1)[:, None]
    try:
        hull = Delaunay(middle + (points - middle) * (1.0 + RIM / np.maximum(spread, RIM)))
    except QhullError:
        return patch
    inside = hull.find_simplex(center[faces, :2]) >= 0
    return np.union1d(patch, faces[inside])


# a box --------------------------------------------------------------------------------------------------------------


def in_box(scan: Scan, scene: Segmentation, support: tuple[float, ...], prompt: str) -> Pointed:
    """The faces in the box, or the thing inside it."""
    text = f"--support {','.join(f'{one:g}' for one in support)}"
    center, ends = in_file(scan, scene.mesh.triangles.mean(axis=1)), np.array(support).reshape(2, 3)
    inside = ((center >= ends[0]) & (center <= ends[1])).all(axis=1)
    if not inside.any():
        raise InputError(f"{text} holds nothing of the scene: {in_words(scan)}; give a box of the file's own frame")
    normal = scene.mesh.face_normals
    area = 0.5 * np.linalg.norm(normal, axis=1)
    structure = np.array([one.structure for one in scene.instances] + [False])[scene.face_instance]
    floors = np.array([one.structure and one.label == "floor" for one in scene.instances] + [False])[
        scene.face_instance
    ]
    up = (normal[:, 2] > 2.0 * LEVEL * area) & inside
    chosen = inside & ~structure
    if area[up & chosen].sum() < LEAST_AREA:
        chosen = inside & floors
    if area[up & chosen].sum() < LEAST_AREA:
        raise InputError(f"{text} holds no surface that looks up and carries: {in_words(scan)}; give a box around one")
    share = np.bincount(scene.face_instance[up & chosen] + 1, area[up & chosen], len(scene.instances) + 1)
    owner = int(np.argmax(share)) - 1
    one = scene.instances[owner] if owner >= 0 else None
    name = Name("thing", renamed=False) if one is None else name_of(one, asked_thing(prompt), "--support")
    if one is not None:
        mine = scene.face_instance == owner
        held = float(area[mine & inside].sum() / max(float(area[mine].sum()), 1e-12))
        if held >= WHOLE and share[owner + 1] >= MOSTLY * share.sum():
            return Pointed(one.id, name.label, "", np.zeros(0), none(), name.renamed, name.notes)
    return cut_out(scene, np.flatnonzero(chosen), name, one, np.zeros(0), [*name.notes])


# the scene ----------------------------------------------------------------------------------------------------------


def cut_out(
    scene: Segmentation, faces: Index, name: Name, owner: Instance | None, position: Array, notes: list[str]
) -> Pointed:
    """A new thing of some faces."""
    taken = {one.id for one in scene.instances}
    plain = f"{name.label.replace(' ', '_')}_pointed_at"
    unique = next(one for one in (plain, *(f"{plain}_{k}" for k in range(1, len(taken) + 2))) if one not in taken)
    if owner is not None and owner.structure:  # part of a floor stays a floor
        return Pointed(unique, owner.label, "floor", position, runs_of(faces), False, tuple(notes))
    return Pointed(unique, name.label, carrying_part(name.label), position, runs_of(faces), False, tuple(notes))


def with_new_thing(scene: Segmentation, pointed: Pointed) -> Segmentation:
    """The scene with the cut-out faces as a further instance of one part."""
    faces = faces_of(pointed.cut)
    box = min_area_box(scene.mesh.corners(faces).reshape(-1, 3))
    box = replace(box, half_extents=np.maximum(box.half_extents, 5e-4))
    before = scene.face_instance[faces]
    old = scene.instances[int(np.bincount(before[before >= 0]).argmax())] if (before >= 0).any() else None
    thing = Instance(
        id=pointed.base_id,
        label=pointed.label,
        box=box,
        parts=(Part(pointed.part, box, 1.0),),
        front=None if old is None else old.front,
        structure=old is not None and old.structure and pointed.label == old.label,
        confidence=1.0,
    )
    face_instance, face_part = scene.face_instance.copy(), scene.face_part.copy()
    face_instance[faces], face_part[faces] = len(scene.instances), 0
    return replace(scene, instances=(*scene.instances, thing), face_instance=face_instance, face_part=face_part)


def with_new_name(scene: Segmentation, pointed: Pointed) -> Segmentation:
    """The scene with an instance under another label, its parts segmented again."""
    index = scene.index_of(pointed.base_id)
    faces = np.flatnonzero(scene.face_instance == index).astype(np.int64)
    instance, part = make_instance(pointed.base_id, pointed.label, FaceTable.of(scene.mesh), faces, None, [])
    front = scene.instances[index].front if instance.front is None else instance.front
    instances, face_part = list(scene.instances), scene.face_part.copy()
    instances[index] = replace(instance, front=front, confidence=1.0)
    face_part[faces] = part
    return replace(scene, instances=tuple(instances), face_part=face_part)


def runs_of(faces: Index) -> Index:
    """Sorted face numbers as runs, first and one past the last, shape (k, 2)."""
    cuts = np.flatnonzero(np.diff(faces) > 1)
    return np.stack([faces[np.r_[0, cuts + 1]], faces[np.r_[cuts, len(faces) - 1]] + 1], axis=1).astype(np.int64)


def faces_of(runs: Index) -> Index:
    """The faces of runs (k, 2)."""
    return np.concatenate([np.arange(first, end) for first, end in runs])


def none() -> Index:
    """No faces."""
    return np.zeros((0, 2), dtype=np.int64)
