"""Prints times of the parts of a placement against plain references on the same machine, and of whole drops."""

import hashlib
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from trimesh.creation import icosphere

from dcap.geometry.camera import looking_at
from dcap.geometry.distance import BAND, MeshDistance, lattice, sampled
from dcap.geometry.primitives import Box
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.picture import picture
from dcap.geometry.solid.support import support_solid
from dcap.scene.settings import PROJECT_ROOT
from dcap.scene.types.mesh import Mesh
from perf import aims, pictures, repair, segments, splats, workflow
from perf.drops import drop_rows, mls_speed
from perf.stopwatch import best
from tasks.artifact import Store
from tasks.code import code_of

GRID = 700
"""Side of the test mesh: about a million triangles, the size of a scanned room."""


def sheet() -> Mesh:
    """A wavy sheet of 2 * 699^2 triangles, 4 m wide."""
    x, y = np.meshgrid(np.linspace(-2, 2, GRID), np.linspace(-2, 2, GRID), indexing="ij")
    corner = np.arange(GRID * GRID).reshape(GRID, GRID)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return Mesh.of(np.stack([x, y, 0.1 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3), faces)


def store_rows(mesh: Mesh) -> list[tuple[str, float, str, float]]:
    """Saving and loading against hashing the same number of bytes."""
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        ref = store.save(mesh)
        data = bytes(store.size(ref))
        digest = best(lambda: hashlib.sha256(data))
        return [
            ("load a million triangles", best(lambda: store.load(ref)), "SHA-256 of the bytes", digest),
            ("verify them", best(lambda: Store(store.root).has(ref)), "SHA-256 of the bytes", digest),
        ]


def ray_rows(mesh: Mesh) -> list[tuple[str, float, str, float]]:
    """A picture's worth of rays against sorting as many numbers."""
    caster = Raycaster(mesh)
    count = 1024 * 1024
    origins = np.random.default_rng(0).uniform([-2, -2, 2], [2, 2, 3], (count, 3))
    down = np.broadcast_to([0.0, 0.0, -1.0], (count, 3)).copy()
    return [
        (
            "cast a million rays",
            best(lambda: caster.cast(origins, down)),
            "sort a million numbers",
            best(origins[:, 0].copy().argsort),
        ),
    ]


def picture_rows(mesh: Mesh) -> list[tuple[str, float, str, float]]:
    """A picture with shadows, as of a placement, against the first ray of each of its pixels."""
    camera = looking_at(np.array([2.0, -3.0, 2.0]), np.zeros(3), 1024, 1024)
    caster, ways = Raycaster(mesh), camera.directions(camera.pixel_centers)
    rays = packed_rays(np.broadcast_to(camera.position, ways.shape), ways)
    return [
        (
            "take a picture of 1024 x 1024",
            best(lambda: picture([mesh], camera)),
            "cast a ray through each pixel",
            best(lambda: caster.first_hits(rays)),
        ),
    ]


def distance_rows() -> list[tuple[str, float, str, float]]:
    """Samples of a distance as contact reads it, and the solid under faces seen from above, against exact distances."""
    ball = Mesh.of(*(np.asarray(part) for part in (icosphere(5, 0.1).vertices, icosphere(5, 0.1).faces)))
    field, spacing = MeshDistance(ball), 0.2 / 110
    low, high = ball.bounds - 0.01, ball.bounds + 0.01
    grid = sampled(field, low[0], high[1], spacing)
    points = lattice(grid.origin, spacing, np.array(grid.values.shape))
    near = points[np.abs(grid.values.ravel()) < BAND * spacing]
    return [
        ("sample the distance to a ball", best(lambda: sampled(field, low[0], high[1], spacing)),
         f"{len(near)} exact distances", best(lambda: field.unsigned(near))),
        ("the solid under a box without bottom", best(under_box), "the same distances", best(lambda: field(near))),
    ]  # fmt: skip


def under_box() -> MeshDistance:
    """Repair of a box of 2 x 1 x 0.3 m seen from above, whose upright edges are borders."""
    box = Box(np.array([2.0, 1.0, 0.3])).surface(2.0)
    seen = box.submesh(np.flatnonzero(box.face_normals[:, 2] > -1e-12))
    return support_solid(seen, np.full(len(seen.faces), -0.3), box.bounds, 0.25)


def digest_rows() -> list[tuple[str, float, str, float]]:
    """Detecting changed code from the stored digest of each source, against reading it."""
    path = PROJECT_ROOT / "tasks" / "drop" / "stage.py"
    names = [name for name in code_of(path).files if name.endswith(".py")]

    def look_up() -> None:
        code_of.cache_clear()
        code_of(path)

    def read() -> list[bytes]:
        return [(PROJECT_ROOT / name).read_bytes() for name in names]

    return [("know a stage's code", best(look_up), "read it", best(read))]


def main() -> None:
    """Measure and print."""
    mesh = sheet()
    table = Table("what", "s", "against", "s", "ratio", box=None)
    ratios = [*store_rows(mesh), *ray_rows(mesh), *picture_rows(mesh), *distance_rows(), *digest_rows()]
    for what, seconds, against, reference in ratios:
        table.add_row(what, f"{seconds:.4f}", against, f"{reference:.4f}", f"{seconds / reference:.1f}")
    console = Console(highlight=False, width=120)
    console.print(table)
    console.print(workflow.table())
    console.print(pictures.table())
    titles = ["drop", "particles", "steps", "Newton", "linear", "wall", "per particle and step", "memory", "depth"]
    drops = Table(*titles, "ratio", box=None)
    rows, memory = drop_rows()
    for row in rows:
        drops.add_row(*row)
    console.print(drops)
    console.print(memory)
    console.print(f"mls: {mls_speed() / 1e6:.1f} million particle-steps a second")
    for line in repair.summaries(*repair.measured()):
        console.print(line)
    console.print(segments.table())
    console.print(aims.table(aims.embedded()))
    found = splats.measured()
    console.print(
        f"{splats.ROOMS[0]}: {found.splats:,} splats to a mesh of {found.faces:,} faces in {found.seconds:.0f} s and "
        f"{found.memory / 2**20:.0f} MiB; {splats.FRAME_SPLATS:,} at 640 x 480: {found.frames:.1f} frames a second"
    )
    for name in splats.ROOMS:
        console.print(
            f"{name}: visible furniture is {1e3 * found.mean[name]:.1f} mm off the mesh of the splats, 95 % "
            f"within {1e3 * found.p95[name]:.1f} mm"
        )
    apart = segments.heads()
    for name, *numbers in found.segments:
        apart.add_row(f"{name}, splats", *numbers)
    console.print(apart)
    console.print(
        f"pictures of the splats against the room's own: {found.psnr:.1f} dB (mean of {splats.VIEWS} views, PSNR)"
    )


if __name__ == "__main__":
    main()
