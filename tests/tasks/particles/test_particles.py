"""The bodies that the drop gets: mass, volume, clamps, materials and fields of a known bed and known objects."""

from functools import cache

import numpy as np
import pytest
import trimesh

from dcap.geometry.distance import sampler
from dcap.scene.errors import GeometryError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor, Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY, NodeState, Particles, RigidSimulationBody, SoftSimulationBody
from dcap.scene.types.segmentation import Instance, Part, Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.types.settled import EndPose
from tasks.bodies.footprint import PER_CELL
from tasks.bodies.plan_contact import share_within
from tasks.codec import encode
from tasks.particles.config import ParticlesConfig
from tasks.particles.stage import particles

FOAM = Material("foam", 50.0, 2e4, 0.3, 0.6, 0.5, 0.002, "soft", "test")
WOOD = Material("wood", 700.0, 1e10, 0.3, 0.5, 0.4, 0.001, "rigid", "test")
DOWN = Material("down", 30.0, 1e4, 0.2, 0.7, 0.6, 0.003, "soft", "test")
CLOTH = Material("cloth", 200.0, 1e5, 0.2, 0.6, 0.5, 0.002, "thin", "test")
BALL_RADIUS, TOP, BOTTOM, NOISE = 0.1, 0.5, 0.28, 0.001


def box_mesh(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    mesh = trimesh.creation.box(b - a)
    return Mesh.of(mesh.vertices + (a + b) / 2, mesh.faces)


def sheet(low: tuple[float, ...], high: tuple[float, ...], z: float, count: int, noise: float = 0.0) -> Mesh:
    """What a scan shows of a flat top."""
    x, y = np.meshgrid(np.linspace(low[0], high[0], count), np.linspace(low[1], high[1], count), indexing="ij")
    height = z + noise * np.random.default_rng(0).standard_normal(x.shape)
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh.of(np.stack([x, y, height], -1).reshape(-1, 3), faces)


def around(mesh: Mesh) -> OrientedBox:
    """The upright box of a mesh."""
    low, high = mesh.bounds
    return OrientedBox((low + high) / 2, np.eye(3), np.maximum((high - low) / 2, 1e-4))


def segmented(things: dict[tuple[str, bool], dict[str, Mesh]]) -> Segmentation:
    """A scene of instances (id, structure) with named parts."""
    meshes = [m for parts in things.values() for m in parts.values()]
    instances = tuple(
        Instance(
            name, name.split("_")[0], around(Mesh.concatenate(list(parts.values()))),
            tuple(Part(p, around(m), 1.0) for p, m in parts.items()), None, structure,
        )
        for (name, structure), parts in things.items()
    )  # fmt: skip
    counts = [len(m.faces) for m in meshes]
    owner = [i for i, parts in enumerate(things.values()) for _ in parts]
    part = [p for parts in things.values() for p in range(len(parts))]
    return Segmentation(
        Mesh.concatenate(meshes), instances, np.repeat(owner, counts).astype(np.int32),
        np.repeat(part, counts).astype(np.int32),
    )  # fmt: skip


def bed() -> Segmentation:
    """A mattress seen from above and from the sides with a blanket's sheet, a frame, a box beside and a wall."""
    block = box_mesh((-0.8, -1.0, BOTTOM), (0.8, 1.0, TOP))
    sides = block.submesh(np.flatnonzero(np.abs(block.face_normals[:, 2]) < 1e-9))
    mattress = Mesh.concatenate([sheet((-0.8, -1.0), (0.8, 0.5), TOP, 76, NOISE), sides])
    blanket = sheet((-0.8, 0.5), (0.8, 1.0), TOP, 40)
    parts = {"mattress": mattress, "frame": box_mesh((-0.85, -1.05, 0.0), (0.85, 1.05, BOTTOM)), "blanket": blanket}
    return segmented(
        {
            ("bed_0", False): parts,
            ("box_1", False): {"body": box_mesh((0.13, -0.1, TOP - 0.001), (0.3, 0.1, TOP + 0.15))},
            ("wall_2", True): {"wall": box_mesh((-2.0, 1.1, 0.0), (2.0, 1.2, 2.5))},
        }
    )


def ball(radius: float = BALL_RADIUS) -> Mesh:
    """A closed ball."""
    mesh = trimesh.creation.icosphere(4, radius)
    return Mesh.of(mesh.vertices, mesh.faces)


def item(**parts: Mesh) -> Segmentation:
    """An object of named parts."""
    return segmented({("object", False): dict(parts)})


def asked(mass: float, *, hollow: bool) -> Intent:
    """An intent that wants this mass."""
    nothing = RegionRequest("", ("center",), (), "")
    free = OrientationRequest("any", "", "")
    return Intent("bed_0", "bed", "ball", np.full(3, 0.2), mass, hollow, 1.0, free, nothing, (), ())


def above(point: tuple[float, float, float], part: int = 0) -> Anchor:
    """The object's origin at a point."""
    pose = np.eye(4)
    pose[:3, 3] = point
    polygon = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    surface = np.array([point[0], point[1], TOP])
    name = ("mattress", "frame", "blanket")[part]
    return Anchor("bed_0", name, part, "center", np.zeros(2), surface, pose, 0.01, polygon, "test")


def chosen(**object_parts: Material) -> PartMaterials:
    """Materials of the object's parts and of the bed."""

    def row(body: str, part: str, index: int, material: Material) -> PartMaterial:
        model = BodyModel.RIGID if material.youngs_modulus > 1e9 else BodyModel.MPM
        return PartMaterial(body, part, index, material, model, "test")

    rows = [row("object", name, i, m) for i, (name, m) in enumerate(object_parts.items())]
    rows += [
        row("bed_0", n, i, m)
        for i, (n, m) in enumerate(zip(("mattress", "frame", "blanket"), (FOAM, WOOD, CLOTH), strict=True))
    ]
    return PartMaterials(tuple(rows), "none")


def soft_body(found: Particles, index: int) -> SoftSimulationBody:
    """A body that must be soft."""
    body = found.bodies[index]
    assert isinstance(body, SoftSimulationBody)
    return body


@cache
def ball_on_bed() -> Particles:
    """A hollow rigid ball of 1 kg, 1 cm above the mattress, next to a box."""
    found = particles(
        SegmentedScene(bed()), SegmentedObject(item(body=ball())),
        asked(1.0, hollow=True), above((0.0, 0.0, TOP + BALL_RADIUS + 0.01)),
        chosen(body=WOOD),
        ParticlesConfig(),
    )  # fmt: skip
    assert isinstance(found, Particles)
    return found


@pytest.mark.slow
def test_bodies_are_the_object_the_base_and_what_is_in_reach() -> None:
    """Object first, then the bed's soft body, then the box; walls and the frame deep under the mattress are absent, for
    nothing reaches them; all but the object are fixed.
    """
    found = ball_on_bed()
    assert [b.name for b in found.bodies] == ["object", "bed_0", "box_1"]
    kinds = [RigidSimulationBody, SoftSimulationBody, RigidSimulationBody]
    assert [type(b) for b in found.bodies] == kinds
    assert [b.fixed for b in found.bodies] == [False, True, True]
    assert [b.instance for b in found.bodies] == ["object", "bed_0", "box_1"]
    assert any("box_1" in note for note in found.notes)


def test_a_hollow_ball_weighs_what_was_asked() -> None:
    """Mass is the prior's, the inertia that of a uniform ball of that mass, 2/5 m R^2, and the note says what was
    scaled.
    """
    body = ball_on_bed().bodies[0]
    # inscribed triangles: volume; inertia 5/3 of it
    facets = 3.0 * (1.26 * BALL_RADIUS / 16) ** 2 / (6.0 * BALL_RADIUS**2)
    assert body.inertial.mass == 1.0
    assert np.allclose(np.diag(body.inertial.inertia), 0.4 * BALL_RADIUS**2, rtol=facets * 5 / 3)
    assert np.allclose(body.inertial.center_of_mass, [0, 0, TOP + BALL_RADIUS + 0.01], atol=1e-9)
    assert any("so that it weighs 1 kg" in note for note in ball_on_bed().notes)


def test_the_mattress_is_a_solid_block_within_the_crop() -> None:
    """Particle volume is crop area times thickness, although the scan shows no underside: crop = ball + 0.15 m
    around, 2.5 times that because a ball may roll.
    """
    body = soft_body(ball_on_bed(), 1)
    area = (2.0 * BALL_RADIUS + 2.0 * 2.5 * 0.15) ** 2
    # mean height of the noise under the crop: its standard error over 25 x 25 scan points
    assert body.points.volume.sum() / area == pytest.approx(TOP - BOTTOM, abs=4 * NOISE / 25 + 2e-4)
    assert np.allclose(body.points.density, FOAM.density)
    assert np.allclose(body.points.youngs_modulus, FOAM.youngs_modulus)
    assert (body.points.position[:, 2] > BOTTOM - 1e-9).all()


def test_the_mattress_is_held_at_the_cut_and_on_its_frame_only() -> None:
    """Nodes of the four cut faces and of the bottom are held; all others within the block are free."""
    body = soft_body(ball_on_bed(), 1)
    held = body.grid.node_state == NodeState.HELD
    for axis in (0, 1):
        assert np.take(held, 0, axis).all()
        assert np.take(held, -1, axis).all()
    assert held[:, :, body.grid.z < BOTTOM + 1e-3].all()
    inner = body.grid.node_state[1:-1, 1:-1, np.flatnonzero(body.grid.z > BOTTOM + 0.02)]
    assert (inner == NodeState.FREE).all()


def test_cells_under_the_contact_resolve_it() -> None:
    """Cells are between a sixth and a quarter of the Hertz radius where the ball will touch, and larger far from it."""
    found = ball_on_bed()
    body = soft_body(found, 1)
    # [J85] a = (3 W R / (4 E*))^(1/3), the ball being rigid
    hertz = (0.75 * GRAVITY * BALL_RADIUS * (1 - FOAM.poisson_ratio**2) / FOAM.youngs_modulus) ** (1 / 3)
    # the radius of curvature is measured on facets and a noisy gap: good to a fifth, its cube root to 7 %
    assert 0.93 * hertz / 6 < found.resolution < 1.07 * hertz / 4
    for planes in (body.grid.x, body.grid.y):
        step = np.diff(planes)
        middle = np.abs(0.5 * (planes[1:] + planes[:-1]))
        assert step[middle < hertz].max() < 1.07 * hertz / 4
        assert step.max() > 2.0 * found.resolution


def test_a_second_drop_is_resolved_where_the_first_one_ended() -> None:
    """A ball that rolled 0.4 m finds fine cells there and where it first came down."""
    first = ball_on_bed()
    again = particles(
        SegmentedScene(bed()), SegmentedObject(item(body=ball())), asked(1.0, hollow=True),
        above((0.0, 0.0, TOP + BALL_RADIUS + 0.01)), chosen(body=WOOD), ParticlesConfig(),
        EndPose((0.0, -0.4, -0.02), (1.0, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    assert isinstance(again, Particles)
    assert first.foreseen is not None
    assert again.foreseen is not None
    assert again.foreseen[0] == pytest.approx(first.foreseen[0])
    assert again.foreseen[1].mean(axis=0) == pytest.approx([0.0, -0.4], abs=0.01)
    rolled = np.array([[0.0, -0.4, TOP]])
    assert (share_within(rolled, first.foreseen), share_within(rolled, again.foreseen)) == (0.0, 1.0)

    def cell_at(found: Particles, y: float) -> float:
        planes = soft_body(found, 1).grid.y
        return float(np.diff(planes)[np.searchsorted(planes, y) - 1])

    assert cell_at(first, -0.4) > 3.0 * cell_at(first, 0.0)
    assert cell_at(again, -0.4) == pytest.approx(cell_at(again, 0.0), rel=0.3)


def test_fields_and_surfaces_fit_together() -> None:
    """Surface points lie in the grid, on the zero of the body's own field; a point 2 cm above the mattress is 2 cm
    away.
    """
    for body in ball_on_bed().bodies[:2]:
        value = sampler(body.distance)(body.surface.vertices)
        inside = (body.surface.vertices >= body.distance.origin).all(axis=1)
        inside &= (
            body.surface.vertices
            <= body.distance.origin + body.distance.spacing * (np.array(body.distance.values.shape) - 1)
        ).all(axis=1)
        # trilinear interpolation rounds a noisy or curved surface by a fraction of the spacing
        assert np.abs(value[inside]).max() < 0.35 * body.distance.spacing
    soft = soft_body(ball_on_bed(), 1)
    low = np.array([p[0] for p in soft.grid.planes])
    high = np.array([p[-1] for p in soft.grid.planes])
    assert ((soft.surface.vertices >= low) & (soft.surface.vertices <= high)).all()
    over = sampler(soft.distance)(np.array([[0.0, 0.0, TOP + 0.02], [0.1, 0.1, TOP - 0.02]]))
    assert over == pytest.approx([0.02, -0.02], abs=3.5 * NOISE)


@pytest.mark.slow
def test_same_input_same_bytes() -> None:
    """Two runs give the same artifact, byte for byte."""
    again = particles(
        SegmentedScene(bed()), SegmentedObject(item(body=ball())),
        asked(1.0, hollow=True), above((0.0, 0.0, TOP + BALL_RADIUS + 0.01)),
        chosen(body=WOOD),
        ParticlesConfig(),
    )  # fmt: skip
    assert encode(again) == encode(ball_on_bed())


@pytest.mark.slow
def test_a_blanket_is_a_thin_layer_on_the_mattress() -> None:
    """Under a blanket seen as a sheet only, its material reaches 2 cm down; below it is the mattress, down to the
    frame.
    """
    found = particles(
        SegmentedScene(bed()), SegmentedObject(item(body=ball(0.05))),
        asked(0.5, hollow=True), above((0.0, 0.75, TOP + 0.06), part=2),
        chosen(body=WOOD),
        ParticlesConfig(base_cells=2000),
    )  # fmt: skip
    assert isinstance(found, Particles)
    soft = soft_body(found, 1)
    depth = TOP - soft.points.position[:, 2]
    far = soft.points.position[:, 1] > 0.5 + 0.05  # away from the seam with the mattress' own top
    cloth = np.isclose(soft.points.density, CLOTH.density)
    layer = 0.02  # usual for a blanket whose edge shows no thickness
    assert cloth[far & (depth < layer)].all()
    assert not cloth[depth > layer].any()
    assert np.isclose(soft.points.density[~cloth], FOAM.density).all()
    assert soft.points.position[:, 2].min() < BOTTOM + 0.05
    assert soft.friction.static == CLOTH.static_friction


@pytest.mark.slow
def test_a_solid_thing_weighs_density_times_volume() -> None:
    """A wooden cube of 10 cm weighs 0.7 kg with inertia m a^2 / 6 where that is plausible, else what is usual."""
    cube = box_mesh((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05))
    for usual, expected in ((0.6, 0.7), (0.1, 0.1)):
        found = particles(
            SegmentedScene(bed()), SegmentedObject(item(body=cube)),
            asked(usual, hollow=False), above((-0.3, 0.0, TOP + 0.06)), chosen(body=WOOD),
            ParticlesConfig(base_cells=500),
        )  # fmt: skip
        assert isinstance(found, Particles)
        body = found.bodies[0]
        assert body.inertial.mass == pytest.approx(expected, rel=1e-9)
        assert np.allclose(body.inertial.inertia, expected * 0.01 / 6.0 * np.eye(3), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_a_rigid_core_moves_with_its_soft_body() -> None:
    """A foam block with a wooden ball in it: core nodes lie in the ball, mass is the sum of both, cells fit the
    budget.
    """
    block, core = box_mesh((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)), ball(0.05)
    config = ParticlesConfig(base_cells=500, object_cells=1500)
    natural = FOAM.density * 0.008
    found = particles(
        SegmentedScene(bed()), SegmentedObject(item(body=block, core=core)),
        asked(natural, hollow=False), above((-0.3, 0.0, TOP + 0.11)),
        chosen(body=DOWN, core=WOOD), config,
    )  # fmt: skip
    assert isinstance(found, Particles)
    body = found.bodies[0]
    assert isinstance(body, SoftSimulationBody)
    grid = np.stack(np.meshgrid(*body.grid.planes, indexing="ij"), axis=-1)
    away = np.linalg.norm(grid - [-0.3, 0.0, TOP + 0.11], axis=-1)
    core_nodes = body.grid.node_state == NodeState.CORE
    assert core_nodes.sum() >= 8
    # a closed part is where its own surface says, up to the sagitta of its facets
    assert away[core_nodes].max() < 0.05
    assert core_nodes[away < 0.05 - (1.26 * 0.05 / 16) ** 2 / (6 * 0.05)].all()
    # the surface of the core inside is no surface of the solid: nothing is lost there
    assert body.points.volume.sum() == pytest.approx(0.008, rel=0.002)
    assert (body.points.volume * body.points.density).sum() == pytest.approx(body.inertial.mass, rel=1e-9)
    # PADDING keeps two free cells around the surface
    assert body.grid.x[0] < -0.4 - 1.99 * (body.grid.x[1] - body.grid.x[0])


@pytest.mark.slow
def test_too_many_particles_are_refused_with_the_knob() -> None:
    """The message names the number, the limit and what to change."""
    with pytest.raises(GeometryError, match=r"particles > 1000; lower ParticlesConfig.object_cells .* base_cells"):
        particles(
            SegmentedScene(bed()), SegmentedObject(item(body=ball())),
            asked(1.0, hollow=True), above((0.0, 0.0, 0.61)), chosen(body=WOOD),
            ParticlesConfig(particle_limit=1000, base_cells=500),
        )  # fmt: skip


@pytest.mark.slow
def test_faces_under_the_object_are_half_a_cell_or_meet_their_budget() -> None:
    """Where a budget makes them longer a note says so; budget and length belong to the box that may be touched."""
    cells = ball_on_bed().resolution

    def longest(found: Particles) -> float:
        corner = found.bodies[1].surface.triangles
        under = np.abs(corner[:, :, :2]).max(axis=(1, 2)) < 0.03
        return float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)[under].max())

    assert longest(ball_on_bed()) <= cells / PER_CELL * (1 + 1e-9)
    few = particles(
        SegmentedScene(bed()), SegmentedObject(item(body=ball())),
        asked(1.0, hollow=True), above((0.0, 0.0, TOP + BALL_RADIUS + 0.01)),
        chosen(body=WOOD), ParticlesConfig(base_faces=500),
    )  # fmt: skip
    assert isinstance(few, Particles)
    assert cells / PER_CELL < longest(few)
    assert any("ParticlesConfig.base_faces" in note for note in few.notes)
    assert not any("ParticlesConfig.base_faces" in note for note in ball_on_bed().notes)
