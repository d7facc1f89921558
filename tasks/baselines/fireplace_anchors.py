"""Resolves the thing and the surface of a constraint outline, with pictures of the options for the client.

In: the scene, the outlines and a client. Out: the surface that carries, and the other constraints with both sides
known. Where there are several things, or several surfaces of a thing, the client chooses among them in batches. In the
pictures, made on demand, the option is painted in a bright colour, and walls and ceilings are left out; a placement
shows the object in its own colours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.baselines.fireplace.anchors import (
    ABOVE,
    AnchorSurface,
    box_side,
    extent_across,
    joined_box,
    side_ways,
    surfaces_of_part,
)
from dcap.evaluation.baselines.fireplace.placement import SurfaceFrame
from dcap.evaluation.baselines.fireplace.planar import COARSE, InteractionSurface
from dcap.evaluation.baselines.fireplace.problem import ResolvedConstraint
from dcap.evaluation.baselines.fireplace.solve import batched_selection
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.placement.named_regions import ViewerFrame, viewer_frame
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.geometry.segmentation.faces import surface_points
from dcap.language.connect import Client
from dcap.language.protocol.fireplace import CHOICE, ChoiceKind, ChoiceOption, ChoiceRequest, ConstraintOutline
from dcap.language.protocol.requests import Picture, PictureMaker
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.pictures import LOUD, loud
from tasks.requests.surroundings import WIDE, is_floor, part_frame
from tasks.requests.views import room_center

LIFT = 0.004
"""Distance in front of its surface at which a painted outline is drawn [m]."""
CLOSEST = 0.6
"""Least distance of the camera [m]."""
DISTANCE = 1.35
"""Distance of the camera over the diagonal of its target [-]."""
NEARER = 1.1
"""Distance of the camera over the diagonal of a thing alone [-]."""
LARGE = 4.0
"""Largest length of a thing that is shown as a whole [m]."""
STEEP = 1.3
"""Factor of the camera's height for an upward surface, to look into a tub [-]."""
AROUND = 2.2
"""Distance of the camera to a placement over the object's diagonal: the surroundings belong to the picture [-]."""
WAY = (0.85, 0.4, 0.65)
"""Direction from the target to the camera: parts towards the viewer, to his right and up [-]."""
Facts = tuple[tuple[str, float], ...]
LEVEL = 0.5
"""Least vertical part of an upward face's normal [-]."""
COVER, COVER_SPACING = 0.2, 0.04
"""Largest thickness of a thing lying on a part, and spacing of the points at which it is searched [m]."""
MUCH = 0.2
"""Least share of those points that a covering part lies over [-]."""


def thing_picture(scene: Segmentation, index: int, frame: ViewerFrame, size: int) -> NDArray[np.uint8]:
    """One instance in a bright colour in its surroundings."""
    box = scene.instances[index].box
    mine = np.flatnonzero(scene.face_instance == index)
    camera = view(box.center, max(2.5, DISTANCE * box.diagonal), frame, size)
    others = open_room(scene, skipped=index)
    return picture([others, loud(scene.mesh.submesh(mine))], camera, samples=1, shadows=False).rgb


def surface_picture(
    scene: Segmentation, index: int, surface: InteractionSurface, frame: ViewerFrame, size: int
) -> NDArray[np.uint8]:  # fmt: skip
    """One surface of an instance: its own faces painted, a side of a box as a sheet before it."""
    whole = scene.instance_mesh(index)
    low, high = whole.bounds
    middle, reach = 0.5 * (low + high), float(np.linalg.norm(high - low))
    # the camera looks at a floor near the surface, at a thing as a whole
    target = surface.center if reach > LARGE else 0.5 * (middle + surface.center)
    camera = view(target, max(CLOSEST, NEARER * min(reach, LARGE)), frame, size, surface.normal)
    if len(surface.faces):
        painted = loud(scene.mesh.submesh(surface.faces))
        rest = scene.face_instance == index
        rest[surface.faces] = False
        whole = scene.mesh.submesh(np.flatnonzero(rest))
    else:
        ring = surface.outline + LIFT * surface.normal
        fan = np.array([(0, k, k + 1) for k in range(1, len(ring) - 1)], dtype=np.int32).reshape(-1, 3)
        painted = Mesh.of(ring, fan, LOUD)
    return picture([whole, painted], camera, samples=1, shadows=False).rgb


def placement_picture(
    scene: Segmentation, item: Mesh, frame: ViewerFrame, size: int
) -> NDArray[np.uint8]:  # fmt: skip
    """The object at a placement."""
    middle = item.bounds.mean(axis=0)
    reach = max(CLOSEST, AROUND * float(np.linalg.norm(np.ptp(item.bounds, axis=0))))
    return picture([open_room(scene), item], view(middle, reach, frame, size), samples=1).rgb


def resting_picture(item: Mesh, size: int) -> NDArray[np.uint8]:
    """The object alone, resting on one of its surfaces."""
    reach = DISTANCE * float(np.linalg.norm(np.ptp(item.bounds, axis=0)))
    middle = item.bounds.mean(axis=0)
    camera = looking_at(middle + reach * np.array([0.45, -0.8, 0.4]), middle, size, size)
    return picture([item], camera, samples=1, shadows=False).rgb


def view(target: Array, distance: float, frame: ViewerFrame, size: int, normal: Array | None = None) -> Camera:
    """Camera from the viewer's side and above, or from the side that a surface faces."""
    way = WAY[0] * np.append(frame.front, 0.0) + WAY[1] * np.append(frame.right, 0.0) + (0.0, 0.0, WAY[2])
    if normal is not None and normal[2] > 0.5:
        way += np.array([0.0, 0.0, STEEP])
    elif normal is not None and float(way @ normal) < 0.3:
        way = 0.8 * normal + 0.2 * way + (0.0, 0.0, 0.3 if normal[2] > -0.5 else 0.0)
    return looking_at(target + distance * way / np.linalg.norm(way), target, size, size)


def open_room(scene: Segmentation, skipped: int = -1) -> Mesh:
    """The scene without walls and ceilings, and without one instance."""
    hidden = [one.structure and one.label != "floor" for one in scene.instances]
    gone = np.array([*hidden, False])[scene.face_instance]
    if skipped >= 0:
        gone |= scene.face_instance == skipped
    return scene.mesh.submesh(np.flatnonzero(~gone))


@dataclass(frozen=True, eq=False, slots=True)
class Described:
    """An option: its label, its measures and its picture."""

    label: str
    facts: Facts
    picture: PictureMaker


@dataclass(frozen=True, eq=False, slots=True)
class Chooser:
    """Asks a client to choose among options, in batches."""

    client: Client
    prompt: str
    rng: np.random.Generator
    batch: int

    def choose(self, kind: ChoiceKind, sought: str, options: Sequence[Described]) -> int:
        """The number of the chosen option."""

        def decide(batch: Sequence[tuple[str, int]]) -> int:
            shown = tuple(ChoiceOption(name, options[k].label, options[k].facts) for name, k in batch)
            pictures = tuple(Picture(f"option {name}", options[k].picture) for name, k in batch)
            reply = self.client.ask(CHOICE, ChoiceRequest(self.prompt, kind, sought, shown, pictures))
            return dict(batch)[reply.chosen]

        return batched_selection(len(options), decide, self.rng, batch=self.batch)


def covering_parts(scene: Segmentation, index: int, parts: Sequence[int], caster: Raycaster) -> list[int]:
    """Other parts of an instance that lie over much of the upward faces of the given parts."""
    own = (scene.face_instance == index) & np.isin(scene.face_part, np.array(parts))
    upward = scene.mesh.face_normals[:, 2] > LEVEL * 2.0 * scene.mesh.face_areas
    faces = np.flatnonzero(own & upward)
    points, _ = surface_points(scene.mesh.corners(faces), scene.mesh.face_areas[faces], COVER_SPACING)
    up = np.tile((0.0, 0.0, 1.0), (len(points), 1))
    hits = caster.cast(points + ABOVE * up, up)
    over = hits.face[(hits.face >= 0) & (hits.distance < COVER)]
    over = over[(scene.face_instance[over] == index) & ~np.isin(scene.face_part[over], np.array(parts))]
    number, count = np.unique(scene.face_part[over], return_counts=True)
    return [int(part) for part, hit in zip(number, count, strict=True) if hit > MUCH * len(points)]


@dataclass(frozen=True, eq=False, slots=True)
class Carrier:
    """The surface that carries the object."""

    base: Instance
    anchor: AnchorSurface
    frame: ViewerFrame
    """Frame of the whole thing as its viewer sees it."""

    @property
    def rim(self) -> ViewerFrame:
        """The rectangle about the surface, as that viewer sees it."""
        points = self.anchor.surface.outline[:, :2]
        middle = self.frame.center
        local = np.c_[(points - middle) @ self.frame.right, (points - middle) @ self.frame.front]
        low, high = local.min(axis=0), local.max(axis=0)
        at = 0.5 * (low + high)
        center = middle + at[0] * self.frame.right + at[1] * self.frame.front
        return replace(self.frame, center=center, half=np.maximum(0.5 * (high - low), 1e-6))


class AnchorResolver:
    """Resolves outlines in one scene; asks about each thing only once."""

    def __init__(self, scene: Segmentation, chooser: Chooser, picture_size: int) -> None:
        self.scene, self.chooser, self.size = scene, chooser, picture_size
        self.caster = Raycaster(scene.mesh)
        self.known: dict[tuple[str, ...], str] = {}

    def thing(self, outline: ConstraintOutline) -> Instance:
        """The instance that an outline means; it lists the likeliest first."""
        ids = outline.anchors
        if ids not in self.known:
            options = []
            for rank, name in enumerate(ids):
                index = self.scene.index_of(name)
                one = self.scene.instances[index]
                shown = partial(thing_picture, self.scene, index, part_frame(self.scene, one, one.box), self.size)
                options.append(Described(f"{one.label} {name}", (("likelihood", 1.0 / (1.0 + rank)),), shown))
            sought = outline.words or f"anchor of {outline.function}"
            self.known[ids] = ids[self.chooser.choose("thing", sought, options)]
        return self.scene.instances[self.scene.index_of(self.known[ids])]

    # the surface that carries ---------------------------------------------------------------------------------------

    def carrier(self, outline: ConstraintOutline) -> Carrier:
        """The surface of the contact."""
        base = self.thing(outline)
        index = self.scene.index_of(base.id)
        frame = part_frame(self.scene, base, base.box)
        parts = self.parts_of(outline, base)
        way = side_ways(frame)[outline.anchor_side]
        found = [
            one
            for part in parts
            for one in surfaces_of_part(
                self.scene.mesh, self.faces_of(index, part), part, way, outline.anchor_side, self.caster
            )
        ]
        if outline.anchor_side == "top" and (over := covering_parts(self.scene, index, parts, self.caster)):
            # a blanket on its mattress: their visible parts may form one surface
            seen = np.concatenate([self.faces_of(index, part) for part in dict.fromkeys((*parts, *over))])
            together = surfaces_of_part(self.scene.mesh, seen, -1, way, outline.anchor_side, self.caster)
            for one in together:  # of the part that has the largest share of it
                faces = one.surface.faces
                share = np.bincount(self.scene.face_part[faces], self.scene.mesh.face_areas[faces])
                found.append(replace(one, part=int(share.argmax())))
        if not found:  # no planar surface faces that way: fall back to the side of the box
            for part in parts:
                box = base.parts[part].box
                side = box_side(box, part_frame(self.scene, base, box), outline.anchor_side)
                side = replace(side, faces=self.faces_of(index, part))
                found.append(AnchorSurface(side, part, COARSE.offset, side.area, "box"))
        options = [self.described_surface(base, index, one, frame) for one in found]
        sought = outline.words or f"{outline.anchor_side} of the {base.label} that carries the object"
        return Carrier(base, found[self.chooser.choose("anchor_surface", sought, options)], frame)

    def parts_of(self, outline: ConstraintOutline, base: Instance) -> Sequence[int]:
        """The parts that an outline names; all parts if it names none, or names those of another candidate."""
        meant = base.id == outline.anchors[0] and outline.anchor_parts
        return outline.anchor_parts if meant else range(len(base.parts))

    def faces_of(self, index: int, part: int) -> NDArray[np.int64]:
        """Faces of one part."""
        return np.flatnonzero((self.scene.face_instance == index) & (self.scene.face_part == part))

    def described_surface(self, base: Instance, index: int, one: AnchorSurface, frame: ViewerFrame) -> Described:
        """One surface as an option."""
        surface = one.surface
        label = f"{one.kind} surface of the {base.parts[one.part].name}, {surface.name}"
        facts = (
            ("area_m2", one.open_area),
            ("height_m", float(surface.center[2])),
            ("slope_deg", float(np.degrees(np.arccos(np.clip(surface.normal[2], -1.0, 1.0))))),
        )
        return Described(label, facts, partial(surface_picture, self.scene, index, surface, frame, self.size))

    # other constraints ----------------------------------------------------------------------------------------------

    def constraint(self, outline: ConstraintOutline, carrier: Carrier, plane: SurfaceFrame) -> ResolvedConstraint:
        """A constraint other than the contact, in the frame of the surface that carries."""
        thing = self.thing(outline)
        box, frame = self.extent(outline, thing, carrier)
        side = outline.anchor_side
        surface = self.surface_of_side(outline, thing, box, frame)
        metres = outline.metres if outline.share is None else outline.share * extent_across(frame, side)
        turned = surface.transformed(plane.rotation, -plane.rotation @ plane.origin)
        half = frame.half[1] if side in ("left", "right") else frame.half[0]
        return ResolvedConstraint(
            function=outline.function,
            side=outline.object_surfaces[0],
            ring=turned.outline[:, :2],
            center=turned.center,
            normal=turned.normal,
            width=2.0 * float(half),
            metres=metres or 0.0,
            nearest=side != "whole" or 2.0 * float(box.half_extents[:2].max()) > WIDE,
            words=f"{outline.function} {thing.label} {side}",
        )

    def extent(
        self, outline: ConstraintOutline, thing: Instance, carrier: Carrier
    ) -> tuple[OrientedBox, ViewerFrame]:  # fmt: skip
        """The intended box, and its rectangle as the viewer sees it; for a thing on another thing, the viewer of the
        latter."""
        parts = self.parts_of(outline, thing)
        box = thing.box if len(parts) == len(thing.parts) else joined_box([thing.parts[k].box for k in parts])
        if thing.id == carrier.base.id:
            if outline.anchor_side in ("left", "right", "front", "back") and carrier.anchor.part in parts:
                return box, carrier.rim
            return box, part_frame(self.scene, thing, box)
        if is_floor(carrier.base):
            return box, part_frame(self.scene, thing, box)
        return box, viewer_frame(box, np.append(carrier.frame.front, 0.0), room_center(self.scene))

    def surface_of_side(
        self, outline: ConstraintOutline, thing: Instance, box: OrientedBox, frame: ViewerFrame
    ) -> InteractionSurface:  # fmt: skip
        """The side itself: that of the box, or a planar surface of the mesh that faces that way."""
        side = outline.anchor_side
        stood_in = box_side(box, frame, side)
        if side in ("whole", "top", "bottom") or outline.function in ("close_to", "far_from", "in_front_of"):
            return stood_in
        index = self.scene.index_of(thing.id)
        way = side_ways(frame)[side]
        found: list[AnchorSurface] = []
        for part in self.parts_of(outline, thing):
            faces = self.faces_of(index, part)
            found += surfaces_of_part(self.scene.mesh, faces, part, way, side, self.caster)
        found = [one for one in found if one.open_area > 0.25 * stood_in.area]
        found.append(AnchorSurface(stood_in, 0, 0.0, stood_in.area, "box"))
        options = [self.described_surface(thing, index, one, frame) for one in found]
        sought = outline.words or f"{side} of the {thing.label}"
        return found[self.chooser.choose("anchor_surface", sought, options)].surface
