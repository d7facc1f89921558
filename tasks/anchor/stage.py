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
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import ANCHOR
from dcap.language.protocol.replies import AnchorReply
from dcap.scene.types.choices import Anchor, AskedPose, Intent, Lean, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import Instance, Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.choice import Choice, area_at, carrier_masks, carrying_at, choice_of, offset_note, owner, reply_at
from tasks.anchor.leaning import leaning_start
from tasks.anchor.no_room import facing_cautions, no_room, not_level, not_on_it, nothing_left, overhead
from tasks.anchor.request import anchor_request
from tasks.anchor.vessel import rim_cautions
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
        return overhead(base, intent)
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
            found = leaning_anchor(scene, base, item.mesh, pose, intent, reply, caster)
            return found if isinstance(found, Infeasible) else replace(found, pose=facing_alone(rotation.pose, intent))
        choice = choice_of(scene, base, intent, reply, mesh)
        if choice.distance is not None:
            return not_on_it(base, choice.index, intent, choice.distance)
        if not choice.areas:
            return nothing_left(base, choice.index, intent)
        masks = carrier_masks(scene, base, choice, intent, caster)
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
                reason = found.reason + offset_note(intent.at, spot)
                return replace(found, reason=reason, pose=rotation.pose, notes=(*found.notes, *rim))
    if search is None:  # there is always a mask to try, but one without a level face
        return not_level(base, choice.index, intent)
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
    carrier, index = owner(scene, int(hit.face[0]))
    part = carrier.parts[index]
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
        reason=f"{reply.reason}{cover_note(base, choice, carrier, index)}{support_note(start, part.name)}",
        lean=lean,
        notes=(*((choice.note,) if choice.note else ()), *choice.cautions),
    )


def leaning_anchor(
    scene: Segmentation, base: Instance, item: Mesh, pose: Array, intent: Intent, reply: AnchorReply, caster: Raycaster
) -> Anchor | Infeasible:
    """The pre-drop pose of a leaning object."""
    found = leaning_start(scene, base, item, pose, intent, reply, caster)
    if isinstance(found, Infeasible):
        return found
    return anchor_at(scene, base, found.choice, found.start, found.pose, found.search, reply, found.lean)


def facing_alone(asked: AskedPose | None, intent: Intent) -> AskedPose | None:
    """The part of a leaning object's pose that is compared: leaning is checked separately, and the support decides the
    turn."""
    return replace(asked, name="any") if asked is not None and intent.orientation.facing else None


def cover_note(base: Instance, choice: Choice, carrier: Instance, index: int) -> str:
    """Note that a thing other than the intended part carries the object."""
    meant = base.parts[choice.index].name
    if carrier.id != base.id:
        return f"; there the {carrier.label} lies on the {meant}"
    return "" if index == choice.index else f"; there the {carrier.parts[index].name} lies on the {meant}"


def support_note(start: Start, part: str) -> str:
    """Note that not all of the underside is over the support."""
    share = start.spot.share
    return "" if share >= SHARES[0] else f"; {100 * share:.0f} % of its underside is over the {part}"


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
