"""Setup of the drop: the inputs of stage 7 together, the region that takes part, the predicted contact."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.columns import CRACK
from dcap.geometry.solid.height_map import WIDTHS, TornHole
from dcap.geometry.solid.mending import MendedSurface, with_mended
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.materials import BodyModel, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution, about
from dcap.scene.types.particles import LayeredPoints
from dcap.scene.types.scan import BodyGeometry, RepairReport
from dcap.scene.types.segmentation import Instance, Segmentation
from dcap.scene.types.settled import EndPose
from tasks.bodies.discretization import MaterialConstants
from tasks.bodies.footprint import Descent
from tasks.particles.config import ParticlesConfig

OBJECT = "object"
"""The body to place."""

# largest ratio to the softest part of a body: for soft parts, which take three times the iterations at the bound, and
# for rigid parts, whose nodes move as one and whose stiffness counts only in cells shared with other parts
MOST_CONTRAST, RIGID_CONTRAST = 1e4, 100.0
REACH_BELOW = 0.12  # how far below the predicted contact fields are sampled [m]: deeper than any dent
REACH_ABOVE = 0.03  # above the object's top [m]
UNDER = 0.25  # of its larger horizontal side: a hole this near counts as under the object, which may move [-]
OUT_OF_DENT = 2e-3  # height of an object over a dent that it is lifted out of [m]
SPHERICAL = 0.1  # relative spread of a ball's radius; a cube has 0.14


@dataclass(eq=False, slots=True)
class DropSetup:
    """The inputs of the stage, data that several bodies need, and the notes collected while the bodies are built."""

    scene: Segmentation
    item: Segmentation
    intent: Intent
    anchor: Anchor
    materials: PartMaterials
    config: ParticlesConfig
    mesh: Mesh
    """The object at its pre-drop pose."""
    base_index: int
    crop: Array
    """Region of the base that takes part [m], shape (2, 3)."""
    descent: Descent
    """The object over the surface beneath it."""
    returned: Descent | None
    """The object at the end of an earlier drop that came to rest outside the predicted contact."""
    body: str = OBJECT
    """The body as which `item` is simulated, and to which its materials belong."""
    free: frozenset[str] = frozenset()
    """Instances that take part as free bodies, and thus are not obstacles."""
    beside: "tuple[DropSetup, ...]" = ()
    """Setups of further things on the base: their contacts also decide where its cells are fine."""
    borne: float = 0.0
    """Mass that lies on the object [kg]."""
    reach: Array | None = None
    """Box in which any of several free bodies may touch anything [m], shape (2, 3); None: the object's contact
    region."""
    torn: bool = False
    """Whether the scan of the base has a hole under the object, which `scene` has closed."""
    notes: list[str] = field(default_factory=list)
    geometry: list[BodyGeometry] = field(default_factory=list)

    @property
    def base(self) -> Instance:
        """The instance to place on."""
        return self.scene.instances[self.base_index]

    @property
    def contact_region(self) -> Array:
        """Box in which the object may touch anything [m], shape (2, 3): the crop, limited in height to the object's
        path."""
        if self.reach is not None:
            return self.reach.copy()
        top, lowest = float(self.mesh.bounds[1, 2]), float(self.mesh.bounds[0, 2])
        box = self.crop.copy()
        box[:, 2] = lowest - self.descent.gap - REACH_BELOW, top + REACH_ABOVE
        return box

    def in_contact_region(self, triangles: Array) -> NDArray[np.bool_]:
        """Mask of the triangles (n, 3, 3) that reach into the contact region."""
        low, high = self.contact_region
        inside = (triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)
        return np.asarray(inside.all(axis=1))

    def faces_near_crop(self, instance: int, margin: float) -> NDArray[np.int64]:
        """Faces of an instance whose plan reaches into the crop grown by `margin` [m]."""
        faces = np.flatnonzero(self.scene.face_instance == instance)
        corner = self.scene.mesh.corners(faces)[:, :, :2]
        low, high = self.crop[0, :2] - margin, self.crop[1, :2] + margin
        return np.asarray(faces[((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1)])

    def beside_base(self, margin: float) -> list[Mesh]:
        """Things other than the base that are at most `margin` [m] from its box in plan: for example the floor around a
        rug."""
        faces = np.flatnonzero(self.scene.face_instance != self.base_index)
        corner, box = self.scene.mesh.corners(faces)[:, :, :2], self.base.box.corners[:, :2]
        low, high = box.min(axis=0) - margin, box.max(axis=0) + margin
        faces = faces[((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1)]
        owner = self.scene.face_instance[faces]
        return [self.scene.mesh.submesh(faces[owner == one]) for one in np.unique(owner)]

    def note_geometry(self, body: str, parts: list[str], report: RepairReport) -> None:
        """Record the construction of a body's solid, and note where it is uncertain."""
        part = ", ".join(dict.fromkeys(parts))
        self.geometry.append(BodyGeometry(body, part, report))
        if report.problem:
            unsound = f"{body}: {part} could not be made into a valid solid: {report.problem}"
            self.notes.append(Caution(Cause.ASSUMED, unsound))

    def note_stiffness(self, body: str, rows: list[PartMaterial]) -> None:
        """Note the soft parts that are simulated softer than their material."""
        for row, taken in zip(rows, stiffness_of(rows), strict=True):
            if row.model is BodyModel.MPM and taken < row.material.youngs_modulus:
                self.notes.append(
                    f"{body}: {row.part} ({row.material.id}) is simulated with {taken:.3g} Pa instead of "
                    f"{row.material.youngs_modulus:.3g} Pa: {MOST_CONTRAST:g} times its softest part"
                )


def drop_setup(
    scene: Segmentation,
    item: Segmentation,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    config: ParticlesConfig,
    ended: EndPose | None = None,
) -> DropSetup:
    """Put the object at its pre-drop pose, crop the base, and determine the surface beneath the object."""
    mesh = item.mesh.transformed(anchor.world_from_object)
    low, high = mesh.bounds
    margin = max(config.crop_margin * float((high - low)[:2].max()), config.least_crop_margin)
    if is_spherical(mesh):
        margin *= config.rolling_margin
    crop = np.stack([low - margin, high + margin])
    base_index = scene.index_of(anchor.base_id)
    widest = max(WIDTHS)  # includes the whole rim of a hole that reaches into the crop
    whole, surface = with_mended(scene, base_index, crop[:, :2] + np.array([[-widest], [widest]]))
    found = mended_here(surface, mesh)
    if found:
        scene = whole
    torn = bool(found and holes_under(surface, mesh))
    beneath = Raycaster(scene.mesh.submesh(np.flatnonzero(scene.face_instance == base_index)))
    below = float(anchor.surface_point[2])
    descent = Descent.of(mesh, beneath, below, tilts=anchor.lean is None)
    returned = None if ended is None else Descent.of(lifted_out(mesh, ended, beneath), beneath, below, tilts=False)
    setup = DropSetup(
        scene, item, intent, anchor, materials, config, mesh, base_index, crop, descent, returned, torn=torn
    )
    setup.notes += [*materials.notes, *(about(anchor.base_id, note) for note in found)]
    setup.notes.append(f"{anchor.base_id} is cut {margin:.2f} m around the object and clamped at the cut")
    return setup


def lifted_out(mesh: Mesh, ended: EndPose, beneath: Raycaster) -> Mesh:
    """The object at the end of a drop, lifted out of its dent until no point of it is below an upward surface."""
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_quat(ended.quaternion, scalar_first=True).as_matrix()
    moved[:3, 3] = ended.position
    lying = mesh.transformed(moved)
    under = lying.triangles.mean(axis=1)
    left = beneath.left_at(under, np.tile([0.0, 0.0, 1.0], (len(under), 1)))
    moved[2, 3] += OUT_OF_DENT + float(left[left < np.ptp(lying.vertices[:, 2])].max(initial=0.0))
    return mesh.transformed(moved)


def mended_here(surface: MendedSurface, mesh: Mesh) -> list[str]:
    """Descriptions of repairs of the base that matter to the object `mesh`; empty if there are none."""
    notes: list[str] = []
    if holes := holes_under(surface, mesh):
        size = f"{1e2 * holes[0].sides[0]:.2g} x {1e2 * holes[0].sides[1]:.2g} cm under the object"
        closed = (
            f"the scan has a hole of {size}; closed from its rim" if len(holes) == 1 else
            f"the scan has {len(holes)} holes, the largest of {size}; closed from their rims"
        )  # fmt: skip
        notes.append(Caution(Cause.ASSUMED, closed))
    if surface.scraps:
        notes.append(
            f"{surface.scraps} floating scraps of the scan ({1e4 * surface.scrap_area:.3g} cm2 in all) carry nothing "
            "and are left out"
        )
    if surface.turned:
        notes.append(f"{surface.turned} faces of the scan were inside out and are reversed")
    return notes


def holes_under(surface: MendedSurface, mesh: Mesh) -> list[TornHole]:
    """Closed holes, not mere cracks, under or near the object in plan, the largest first."""
    low, high = mesh.bounds[:, :2]
    margin = UNDER * float((high - low).max())
    large = [one for one in surface.holes if one.sides[0] > CRACK]
    under = [one for one in large if (one.low <= high + margin).all() and (one.high >= low - margin).all()]
    return sorted(under, key=lambda one: -one.sides[0] * one.sides[1])


def is_spherical(mesh: Mesh) -> bool:
    """Return whether all points of the surface have nearly the same distance from its centroid."""
    away = np.linalg.norm(mesh.triangles.mean(axis=1) - mesh.vertices.mean(axis=0), axis=1)
    return float(away.std() / away.mean()) < SPHERICAL


def constants_of_parts(
    rows: list[PartMaterial], part: NDArray[np.integer], normals: Callable[[], Array]
) -> MaterialConstants:
    """Material of points that belong to the given parts (n,); `normals` returns the layer normals there, shape (n,
    3)."""
    table = np.array(
        [(r.material.density, e, r.material.poisson_ratio) for r, e in zip(rows, stiffness_of(rows), strict=True)]
    )
    density, stiffness, poisson = table[part].T
    constants = MaterialConstants(density.copy(), stiffness.copy(), poisson.copy())
    return constants if all(r.material.layers is None for r in rows) else with_layers(constants, rows, part, normals())


def stiffness_of(rows: list[PartMaterial]) -> list[float]:
    """Young's modulus with which each part of a soft body is simulated [Pa]."""
    softest = min(r.material.youngs_modulus for r in rows if r.model is BodyModel.MPM)
    most = {BodyModel.MPM: MOST_CONTRAST * softest, BodyModel.RIGID: RIGID_CONTRAST * softest}
    return [min(r.material.youngs_modulus, most[r.model]) for r in rows]


def friction_of_surface(rows: list[PartMaterial], surface: Mesh, mesh: Mesh, part: NDArray[np.integer]) -> Array | None:
    """The friction of each face of a surface (m,) derived from a mesh whose faces belong to the given parts (k,), as in
    `friction_of_faces`."""
    if friction_of_faces(rows, part) is None:
        return None
    return friction_of_faces(rows, part_of_faces(surface, mesh, part))


def friction_of_faces(rows: list[PartMaterial], part: NDArray[np.integer]) -> Array | None:
    """Static and dynamic friction [-] and rolling resistance [m] of faces that belong to the given parts (m,), shape
    (m, 3); None if all parts have the same friction."""
    table = np.array([(f.static, f.dynamic, f.rolling_resistance) for f in (r.material.friction for r in rows)])
    alike = (table[np.unique(part)] == table[part[:1]]).all()
    return None if alike else table[part]


def part_of_faces(surface: Mesh, mesh: Mesh, part: NDArray[np.integer]) -> NDArray[np.int64]:
    """Part of each face of a surface (m,) derived from a mesh whose faces belong to the given parts (k,): the part of
    the mesh's face under its middle, since its corners may lie on several parts."""
    return part[MeshDistance(mesh).nearest_face(surface.triangles.mean(axis=1))].astype(np.int64)


def with_layers(
    constants: MaterialConstants, rows: list[PartMaterial], part: NDArray[np.integer], normal: Array
) -> MaterialConstants:
    """The constants with the layers of those parts (n,) that are layered; a part that is simulated softer is softer in
    all directions."""
    along, in_plane = constants.youngs_modulus.copy(), constants.poisson_ratio.copy()
    shear = along / (2.0 * (1.0 + in_plane))
    for row, taken in zip(rows, stiffness_of(rows), strict=True):
        if (layers := row.material.layers) is not None:
            own, share = part == row.part_index, taken / row.material.youngs_modulus
            along[own], in_plane[own] = share * layers.youngs_modulus, layers.poisson_ratio
            shear[own] = share * layers.shear_modulus
    return constants._replace(layers=LayeredPoints(along, in_plane, shear, normal))
