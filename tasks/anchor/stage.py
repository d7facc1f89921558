"""Stage 5, anchor: the part and the place on it, from which gravity does the rest.

In: scene, object, intent and rotation. Out: `Anchor` with the pre-drop pose, or `no_support_hit`, or
`too_large_for_target`. The region's aim is tried first, then the spots around it: a ray along gravity must hit the
part, the object's underside must be over it, and nothing else may be in the way. Faces need not look up. The object's
centre of mass goes over the anchor, and its lowest points start `clearance` above what lies beneath them, measured
between the meshes, which do not intersect. Next to a thing means neither over nor under it; excluded places and
distances cut the areas (see `constraints.py`); a leaning object starts tilted against its support (`leaning.py`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveFloat
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.placement.clearance import Clearance, Start, set_down
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.poses import center_of_mass
from dcap.geometry.placement.search import SHARES, PlacementSearch
from dcap.geometry.raycast import Raycaster
from dcap.geometry.segmentation.faces import surface_pieces, surface_points
from dcap.geometry.segmentation.labels import plain_structure
from dcap.geometry.solid.mending import with_mended
from dcap.language.connect import Client
from dcap.language.offline.placing import placing_of
from dcap.language.offline.sentence import read
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import ANCHOR
from dcap.language.protocol.replies import AnchorReply
from dcap.scene.errors import LanguageError
from dcap.scene.types.choices import Anchor, Intent, Lean, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution, Infeasible
from dcap.scene.types.segmentation import Instance, Part, Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.choice import Choice, area_at, carrier_masks, carrying_at, choice_of, reply_at
from tasks.anchor.leaning import leaning_start
from tasks.anchor.no_room import facing_cautions, no_room, no_surface, not_on_it, nothing_left
from tasks.anchor.request import anchor_request
from tasks.cache import stage
from tasks.requests.surroundings import part_frame
from tasks.requests.views import instance_of

LEVEL_COS = 0.9
"""Cosine of the largest slope of a level face."""
PIECE_LEVEL = 0.7
"""Least normal z of a carrying face in the middle of a piece [-]."""
PIECE = 0.3
"""Least share of the largest piece's surface that a piece has [-]."""
OVER = 0.05
"""Maximum distance in plan from an aim to a piece [m]."""
REPORTED_OFFSET = 0.02
"""Offset from a given point above which it is reported [m]."""
HELD_UP = 0.01
"""Clearance above the surface below, beyond which something else must hold the object up [m]."""


class AnchorConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client of the anchor, and start of the drop."""

    language: LanguageConfig = LanguageConfig()
    clearance: PositiveFloat = 0.01
    """Smallest vertical gap at the start [m]; the paper's 1 cm."""
    subparts: bool = True
    """Choose part and region; otherwise the aim is the middle of the support: an ablation."""
    face_up: bool = False
    """Only level faces carry, as in methods with planar supports: an ablation."""


def anchor(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    rotation: Rotation,
    prompt: str,
    config: AnchorConfig,
    client: Client,
) -> Anchor | Infeasible:
    """Choose part and region, find a free spot, set the object over it."""
    base = instance_of(scene, intent.base_id)
    if base.structure and intent.at is None and plain_structure(base.label) == "ceiling":
        text = f"{intent.object_name} cannot rest on the {base.label}: its side in the room looks down"
        return no_surface(text, base, base.label)
    if not config.subparts:
        intent = aimed_at_middle(intent, base, Raycaster(scene.mesh))
    pose = np.eye(4)
    pose[:3, :3] = intent.scale * rotation.matrix
    mesh = item.mesh.transformed(pose)
    pose[:3, 3] = -center_of_mass(mesh)
    mesh = item.mesh.transformed(pose)
    reply = None if intent.at is not None else client.ask(ANCHOR, anchor_request(scene, base, intent, prompt, mesh))
    whole, _ = with_mended(scene, scene.index_of(base.id), turn=False)  # a place may be over a hole of the scan
    scene = SegmentedScene(whole)
    caster = Raycaster(scene.mesh)
    if reply is not None:
        if intent.orientation.lean:
            leans = leaning_start(scene, base, item.mesh, pose, intent, reply, caster)
            if isinstance(leans, Infeasible):
                return leans
            found = anchor_at(scene, base, leans.choice, leans.start, leans.pose, leans.search, reply, leans.lean)
            # leaning is checked separately, and the support decides the turn: only a facing is compared
            asked = rotation.pose if intent.orientation.facing else None
            return replace(found, pose=None if asked is None else replace(asked, name="any"))
        choice = choice_of(scene, base, intent, reply, mesh)
        if choice.distance is not None:
            return not_on_it(base, choice.index, intent, choice.distance)
        if not choice.areas:
            return nothing_left(base, choice.index, intent)
        masks = carrier_masks(scene, base, choice.index, intent, caster)
    else:
        assert intent.at is not None
        reply = reply_at(scene, base, intent.at, caster)
        frame = part_frame(scene, base, base.parts[reply.part_index].box)
        guessed = facing_cautions(scene, base, intent)
        choice = Choice(reply.part_index, frame, [area_at(intent.at, mesh)], [], "at the point", cautions=guessed)
        masks = [carrying_at(scene, base, intent.at)]
    exact = Clearance(mesh, scene.mesh, caster)
    anywhere = intent.at is None and reply.point is None
    anywhere &= not (choice.region or intent.region.names or intent.region.constraints)
    search = None
    for areas, note in choice.tries():
        for mask in masks if areas else ():
            carrying = level_alone(scene, mask) if config.face_up else mask
            if not carrying.any():
                continue
            search = PlacementSearch(scene.mesh, caster, carrying, mesh)
            aims = at_own_middles(scene.mesh, mask, areas) if anywhere else areas
            start = set_down(search, exact, aims, config.clearance, anywhere=anywhere)
            if start is not None:
                found = anchor_at(scene, base, replace(choice, note=note), start, pose, search, reply)
                spot, part = np.array([start.spot.x, start.spot.y]), base.parts[choice.index]
                rim = rim_cautions(prompt, base, part, start, found.surface_point, mesh)
                away = 0.0 if intent.at is None else float(np.linalg.norm(spot - intent.at[:2]))
                off = f"; {away:.2f} m from the point, which is not free" if away > REPORTED_OFFSET else ""
                return replace(found, reason=found.reason + off, pose=rotation.pose, notes=(*found.notes, *rim))
    if search is None:  # there is always a mask to try, but one without a level face
        text = f"the {base.parts[choice.index].name} of {base.label} has no level face"
        return no_surface(text, base, base.parts[choice.index].name, " ".join(intent.region.names))
    return no_room(scene, base, choice.index, choice.frame, search, choice.areas, intent, mesh)


anchor_task = stage(anchor)


def aimed_at_middle(intent: Intent, base: Instance, caster: Raycaster) -> Intent:
    """The intent aimed at the middle of the support's box, on the highest surface there, as if the user had pointed at
    it."""
    top = base.box.corners[:, 2].max()
    over = np.array([*base.box.center[:2], top + 0.05])
    way = float(caster.cast(over[None], np.array([[0.0, 0.0, -1.0]])).distance[0])
    return replace(intent, at=over - np.array([0.0, 0.0, way if np.isfinite(way) else 0.05]))


def level_alone(scene: Segmentation, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The upward faces of a mask (m,)."""
    normal = scene.mesh.face_normals
    upward = normal[:, 2] > LEVEL_COS * np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    return np.asarray(mask & upward)


# setting ------------------------------------------------------------------------------------------------------------


def anchor_at(
    scene: Segmentation,
    base: Instance,
    choice: Choice,
    start: Start,
    pose: Array,
    search: PlacementSearch,
    reply: AnchorReply,
    lean: Lean | None = None,
) -> Anchor:
    """The pre-drop pose over the spot."""
    spot = np.array([start.spot.x, start.spot.y])
    hit = search.caster.cast(np.array([[*spot, search.top]]), np.array([[0.0, 0.0, -1.0]]))
    face = int(hit.face[0])
    carrier, index = scene.instances[int(scene.face_instance[face])], int(scene.face_part[face])
    part = carrier.parts[index]
    over = carrier.label if carrier.id != base.id else part.name if index != choice.index else ""
    covered = f"; there the {over} lies on the {base.parts[choice.index].name}" if over else ""
    share = start.spot.share
    partly = "" if share >= SHARES[0] else f"; {100 * share:.0f} % of its underside is over the {part.name}"
    world_from_object = pose.copy()
    world_from_object[:3, 3] += (*spot, start.height)
    return Anchor(
        base_id=carrier.id,
        part=part.name,
        part_index=index,
        region=start.region.name or choice.region or "center",
        local=part_frame(scene, carrier, part.box).local(spot),
        surface_point=hit.position[0],
        world_from_object=world_from_object,
        clearance=start.gap,
        region_polygon=start.region.polygon,
        reason=f"{reply.reason}{covered}{partly}",
        lean=lean,
        notes=(*((choice.note,) if choice.note else ()), *choice.cautions),
    )


def rim_cautions(
    prompt: str, base: Instance, part: Part, start: Start, below: Array, mesh: Mesh
) -> tuple[Caution, ...]:  # fmt: skip
    """A caution if an object that should go into a vessel stays on its rim: it is held up over the bottom, and its
    centre of mass is above the rim. An object that stands in a vessel reaches its bottom, and one that is wedged in it
    has its centre below the rim.

    Args:
        prompt: the sentence.
        base: the vessel.
        part: the part over which the object starts.
        start: where it starts.
        below: the surface under the object's centre of mass [m], shape (3,).
        mesh: the object, its centre of mass at the origin [m].
    """
    lowest = start.height + float(mesh.bounds[0, 2])
    held_up = lowest - below[2] > start.gap + HELD_UP
    if base.structure or not (held_up and start.height > part.box.top):
        return ()
    try:
        if placing_of(read(prompt)).relation != "in":
            return ()
    except LanguageError:
        return ()
    size = np.ptp(mesh.bounds, axis=0)
    text = f"{size[0]:.2f} x {size[1]:.2f} m do not fit into the {base.label}; the object is set on the rim"
    return (Caution(Cause.NOT_MET, text),)


def at_own_middles(mesh: Mesh, mask: NDArray[np.bool_], areas: Sequence[Region]) -> list[Region]:
    """The areas; an area whose aim is over no carrying piece is repeated for each piece, aimed at the middle of the
    piece.

    Args:
        mesh: the scene.
        mask: faces that may carry, shape (m,).
        areas: the areas.
    """
    faces = np.flatnonzero(mask & (mesh.face_normals[:, 2] > PIECE_LEVEL * 2.0 * mesh.face_areas))
    if not len(faces):
        return list(areas)
    piece = surface_pieces(mesh, faces)
    area, center = mesh.face_areas[faces], mesh.triangles[faces].mean(axis=1)[:, :2]
    total = np.bincount(piece, area)
    large = np.flatnonzero(total > PIECE * total.max())
    middles = [np.average(center[piece == one], axis=0, weights=area[piece == one]) for one in large]
    tree = cKDTree(surface_points(mesh.triangles[faces], area, 0.5 * OVER)[0][:, :2])
    found = []
    for one in areas:
        between = len(middles) > 1 and tree.query(one.target)[0] > OVER
        found += [replace(one, target=middle) for middle in middles] if between else [one]
    return found
