"""Stages point and point_out: a point or a box in the scene file's own frame determines the object's support.

In: the scan (for the file's frame), the scene, the sentence and the point or box. Out: `Pointed`; then the scene in
which the indicated thing is a separate instance, if it was not one before: the faces in the box, or the surface around
the point with the faces below it. Its name is the scene's label if that is certain, else the noun of the sentence; a
mismatch is reported. If no upward surface is there, one line gives the reason.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import Delaunay, QhullError

from dcap.arrays import Array, IntArray, Mask
from dcap.geometry.raycast import Raycaster
from dcap.geometry.segmentation.faces import FaceTable, surface_pieces
from dcap.geometry.segmentation.parts.rules import make_instance
from dcap.knowledge.lexicon import first_part, in_line, label_words, thing_of
from dcap.language.offline.nouns import Noun
from dcap.language.offline.placing import names_support, placing_of, whole
from dcap.language.offline.sentence import read
from dcap.scene.errors import InputError, LanguageError
from dcap.scene.types.boxes import min_area_box
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.sample import GivenPlace
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Instance, Part, Pointed, Segmentation, SegmentedScene
from tasks.cache import stage

SURE = 0.9
"""Confidence below which a label is a guess that the sentence overrides [-]."""
PLAIN_PART = "top"
"""Part name for an unknown thing."""
LEVEL = 0.5
"""Least cosine to the vertical of a carrying face: within 60 degrees [-]."""
SUNK = 0.05
"""Largest depth of a point below the intended surface [m]: scans and fingers are imprecise."""
STEP = 1e-4
"""Distance behind an ignored face at which the search continues [m]."""
MOST_FACES = 200
"""Maximum number of faces above each other that are examined [-]."""
ABOVE = 0.1
"""Height of a point over the surface below it, above which the height is reported [m]."""
DOWN = np.array([0.0, 0.0, -1.0])

WHOLE = 0.9
"""Share of a thing's surface in a box, or of its upward surface, from which the whole thing is meant [-]."""
MOSTLY = 0.8
"""Least share of the upward surface in the box that belongs to that thing [-]."""
FUSED = 3.0
"""Area of a thing in plan over that of the indicated surface, above which the thing is more than the support [-]."""
TALL = 1.3
"""Height of a thing over the indicated surface above which it contains a wall [m]."""
BAND = 0.15
"""Largest height difference between the indicated surface and the point [m]: cushions, dents, noise."""
RIM = 0.06
"""Distance outside the surface's outline within which faces below belong to it [m]: fronts, edges."""
LEAST_AREA = 1e-4
"""Least upward surface that can carry anything [m^2]."""


@dataclass(frozen=True, slots=True)
class Name:
    """A label with notes on its origin."""

    label: str
    renamed: bool
    notes: tuple[str, ...] = ()


def asked_thing(prompt: str) -> Noun | None:
    """The support that the sentence names; None if it names none with known words."""
    try:
        place = placing_of(read(prompt)).place
    except LanguageError:
        return None
    noun = whole(place)
    return noun if names_support(place) and noun.thing and noun.thing != "room" else None


def name_of(owner: Instance, asked: Noun | None, option: str) -> Name:
    """Name of an instance that a sentence and a person have both indicated."""
    if asked is None or fits(asked, owner.label):
        return Name(owner.label, renamed=False)
    if owner.structure or owner.confidence >= SURE:
        said = f"the sentence says {asked.text!r}, but {option} lies on {owner.label} ({owner.id}); using {option}"
        return Name(owner.label, renamed=False, notes=(Caution(Cause.NOT_MET, said),))
    label = asked.name or asked.thing.replace("_", " ")
    guess = f"{owner.label!r} ({owner.confidence:.0%})"
    taken = f"the thing under {option} was labelled {guess}; it is now called {label!r} as in the sentence"
    return Name(label, renamed=True, notes=(Caution(Cause.WHICH, taken),))


def fits(noun: Noun, label: str) -> bool:
    """Return whether a label matches a noun, is a kind of it, or the noun is a kind of the label."""
    if tuple(label_words(noun.name)) == tuple(label_words(label)):
        return True
    thing = thing_of(label)
    return thing is not None and in_line(thing.id, noun.thing)


def in_file(scan: Scan, points: Array) -> Array:
    """World points (n, 3) in the file's own frame."""
    file_from_world = np.linalg.inv(scan.world_from_file)
    return np.asarray(points @ file_from_world[:3, :3].T + file_from_world[:3, 3])


def in_words(scan: Scan) -> str:
    """The scene's bounds in the file's own frame, for a message."""
    low, high = scan.mesh.bounds
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    own = in_file(scan, corners)
    spans = (f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", own.min(axis=0), own.max(axis=0), strict=True))
    return f"the scene spans {', '.join(spans)} ({scan.up} up) in its file"


def level_axes(scan: Scan) -> tuple[int, int]:
    """The file's two horizontal axes in their order: x and z for a file with y up."""
    upright = "xyz".index(scan.up.removeprefix("-"))
    first, second = (axis for axis in range(3) if axis != upright)
    return first, second


def meeting(scan: Scan, scene: Segmentation, at: tuple[float, ...]) -> tuple[int, Array]:
    """The face and the point [m] of the intended surface: the nearest below the point, or the highest on the vertical;
    raises InputError if there is none."""
    text = f"--at {','.join(f'{one:g}' for one in at)}"
    own = np.zeros(3)
    own[list(level_axes(scan)) if len(at) == 2 else [0, 1, 2]] = at
    point = scan.world_from_file[:3, :3] @ own + scan.world_from_file[:3, 3]
    low, high = scan.mesh.bounds
    if (point[:2] < low[:2]).any() or (point[:2] > high[:2]).any():
        raise InputError(f"{text} is outside of the scene: {in_words(scan)}; give a point of the file's own frame")
    caster = Raycaster(scene.mesh)
    if len(at) == 2:
        return highest(scan, scene, caster, point, text)
    if point[2] < low[2] - SUNK:
        raise InputError(
            f"{text} is under the floor: {in_words(scan)}; give a higher point, or two numbers: the highest surface"
        )
    if point[2] > high[2] + SUNK:
        raise InputError(
            f"{text} is above the scene: {in_words(scan)}; give a lower point, or two numbers: the highest surface"
        )
    start = np.array([*point[:2], point[2] + SUNK])
    hit = caster.cast(start[None], DOWN[None])
    face = int(hit.face[0])
    if face < 0:
        raise InputError(f"{text} is in the air with nothing below it: {in_words(scan)}; give a point on a surface")
    normal = float(hit.normal[0, 2])
    if normal < -STEP:
        raise InputError(
            f"{text} is inside of {owner_name(scene, face)}: the surface below it faces down; {in_words(scan)};  "
            "give a point on its surface, or two numbers: the highest surface there"
        )
    if normal < LEVEL:
        steep = np.degrees(np.arccos(normal))
        raise InputError(
            f"{text} is over {owner_name(scene, face)} where that is {steep:.0f} degrees steep; nothing stays there: "
            f"give a point on a surface that looks up ({in_words(scan)})"
        )
    return face, hit.position[0]


def highest(scan: Scan, scene: Segmentation, caster: Raycaster, point: Array, text: str) -> tuple[int, Array]:
    """Face and point of the highest upward surface that belongs to no wall or ceiling."""
    start = np.array([*point[:2], float(scene.mesh.bounds[1, 2]) + 1.0])
    of_thing = np.array([not one.structure or one.label == "floor" for one in scene.instances] + [False])
    for _ in range(MOST_FACES):
        hit = caster.cast(start[None], DOWN[None])
        face = int(hit.face[0])
        if face < 0:
            break
        if hit.normal[0, 2] >= LEVEL and of_thing[scene.face_instance[face]]:
            return face, hit.position[0]
        start = hit.position[0] + STEP * DOWN
    raise InputError(f"{text}: there is no upward surface; {in_words(scan)}; give a point over a surface")


def owner_name(scene: Segmentation, face: int) -> str:
    """Name of the owner of a face, for messages."""
    owner = int(scene.face_instance[face])
    return scene.instances[owner].id if owner >= 0 else "the scene"


def point(scan: Scan, scene: SegmentedScene, place: GivenPlace, prompt: str) -> Pointed:
    """The indicated thing; raises InputError with the value and the scene's bounds if nothing carries there."""
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
    face, position = meeting(scan, scene, at)
    owner = int(scene.face_instance[face])
    notes = []
    if len(at) == 2:
        first, second = level_axes(scan)
        own = in_file(scan, position[None])[0]
        notes.append(f"--at: the highest surface at {'xyz'[first]} {at[0]:g}, {'xyz'[second]} {at[1]:g} is at "
                     f"{','.join(f'{one:.4g}' for one in own)}")  # fmt: skip
    else:
        given = scan.world_from_file[:3, :3] @ np.array(at) + scan.world_from_file[:3, 3]
        if given[2] - position[2] > ABOVE:
            above = f"--at is {given[2] - position[2]:.2f} m above a surface; the object is placed on that surface"
            notes.append(Caution(Cause.NOT_MET, above))
    if owner < 0:
        patch = patch_at(scene, face, position)
        return cut_out(scene, patch, Name("thing", renamed=False), None, position, notes)
    one = scene.instances[owner]
    name = name_of(one, asked_thing(prompt), "--at")
    notes += name.notes
    if one.structure or one.confidence >= SURE:
        return Pointed(one.id, name.label, "", position, none(), False, tuple(notes))
    patch = patch_at(scene, face, position)
    mine = scene.face_instance == owner
    box = min_area_box(scene.mesh.corners(patch).reshape(-1, 3))
    plans = [float(np.prod(each.half_extents[:2])) for each in (one.box, box)]
    if plans[0] > FUSED * plans[1] or one.box.top - position[2] > TALL:
        below = under(scene, patch, mine)
        if scene.mesh.face_areas[below].sum() < WHOLE * scene.mesh.face_areas[mine].sum():
            return cut_out(scene, below, name, one, position, notes)
    return Pointed(one.id, name.label, "", position, none(), name.renamed, tuple(notes))


def patch_at(scene: Segmentation, face: int, position: Array) -> IntArray:
    """The connected upward faces of similar height around a face, within the same instance."""
    center, normal = scene.mesh.triangles.mean(axis=1), scene.mesh.face_normals
    up = normal[:, 2] > LEVEL * np.linalg.norm(normal, axis=1)
    near = up & (np.abs(center[:, 2] - position[2]) < BAND) & (scene.face_instance == scene.face_instance[face])
    near[face] = True
    faces = np.flatnonzero(near)
    region = surface_pieces(scene.mesh, faces)
    return np.asarray(faces[region == region[np.searchsorted(faces, face)]])


def under(scene: Segmentation, patch: IntArray, mine: Mask) -> IntArray:
    """A surface together with the faces of its thing below it: fronts and sides that hold it up."""
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
        raise InputError(f"{text} contains nothing of the scene: {in_words(scan)}; give a box of the file's own frame")
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
        raise InputError(
            f"{text} contains no upward surface that can carry an object: {in_words(scan)}; give a box around one"
        )
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
    scene: Segmentation, faces: IntArray, name: Name, owner: Instance | None, position: Array, notes: list[str]
) -> Pointed:
    """A new thing made of some faces."""
    taken = {one.id for one in scene.instances}
    plain = f"{name.label.replace(' ', '_')}_pointed_at"
    unique = next(one for one in (plain, *(f"{plain}_{k}" for k in range(1, len(taken) + 2))) if one not in taken)
    if owner is not None and owner.structure:  # part of a floor stays a floor
        return Pointed(unique, owner.label, "floor", position, runs_of(faces), False, tuple(notes))
    thing = thing_of(name.label)
    part = first_part(thing.id if thing else "") or PLAIN_PART  # with which such a thing usually carries
    return Pointed(unique, name.label, part, position, runs_of(faces), False, tuple(notes))


def with_new_thing(scene: Segmentation, pointed: Pointed) -> Segmentation:
    """The scene with the cut-out faces as a further instance of one part."""
    faces = np.concatenate([np.arange(first, end) for first, end in pointed.cut])
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


def runs_of(faces: IntArray) -> IntArray:
    """Sorted face numbers as runs, first and one past the last, shape (k, 2)."""
    cuts = np.flatnonzero(np.diff(faces) > 1)
    return np.stack([faces[np.r_[0, cuts + 1]], faces[np.r_[cuts, len(faces) - 1]] + 1], axis=1).astype(np.int64)


def none() -> IntArray:
    """An empty list of faces."""
    return np.zeros((0, 2), dtype=np.int64)
