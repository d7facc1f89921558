"""Gaussian splats: known rooms as splats and back as meshes, with the distance and the visual similarity of the two;
frames per second.

python -m perf.splats          measure, and print as JSON on standard output
"""

import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import looking_at
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import psnr, unlit
from dcap.geometry.splatting.camera_path import PathConfig, camera_path
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.geometry.splatting.render import Splatter
from dcap.geometry.splatting.surface import mesh_of_splats
from dcap.geometry.splatting.viewpoints import viewpoints
from dcap.packages import module_command
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.rooms import BuiltRoom, build_room
from perf import segments
from solver.runtime import available_cores, start

ROOMS = ("bedroom_01", "living_01", "kids_01")
"""The first one is timed, too."""
SPLATS, FRAME_SPLATS = 500_000, 100_000
FRAMES = 20
VIEWS = 12
"""Number of pictures that are compared with the room's own [-]."""
SHELL = ("wall", "floor", "ceiling", "window", "door", "curtain")
"""Labels other than furniture."""
CLEAR = 2e-3
"""Largest distance of a ray's first hit from a visible point [m]."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Results of the measurement."""

    splats: int
    faces: int
    """Of the first room's mesh."""
    seconds: float
    """Of its reconstruction [s]."""
    memory: float
    """Peak memory until its end [byte]."""
    mean: dict[str, float]
    """Mean distance from the visible furniture to the mesh, by room [m]."""
    p95: dict[str, float]
    """95th percentile of that distance by area [m]."""
    frames: float
    """Pictures of FRAME_SPLATS splats a second [1/s]."""
    psnr: float
    """PSNR of pictures of the first room's splats against its own [dB]."""
    segments: list[list[str]]
    """Rows of `segments.heads()` for the meshes of splats."""


def measured() -> Measured:
    """Measure in a fresh process."""
    output = subprocess.run(module_command("perf.splats"), check=True, capture_output=True, text=True).stdout
    return Measured(**json.loads(output))


def seen_furniture(room: BuiltRoom, places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles (n, 3) and areas (n,) of the faces of furniture that are visible from one of the places (k, 3)."""
    mesh = room.record.mesh
    own = np.flatnonzero(~np.isin(np.array(room.instance_labels)[room.face_instance], SHELL))
    middle, normal = mesh.triangles[own].mean(axis=1), mesh.face_normals[own]
    length = np.linalg.norm(normal, axis=1)
    normal = normal / np.maximum(length, 1e-30)[:, None]
    caster, seen = Raycaster(mesh), np.zeros(len(own), dtype=bool)
    for place in places:
        way = place - middle
        distance = np.linalg.norm(way, axis=1)
        way /= distance[:, None]
        front = np.einsum("ni,ni->n", way, normal) > 0.1
        hit = caster.cast(middle + 1e-3 * normal, way).distance
        seen |= front & (hit > distance - CLEAR)
    return middle[seen], 0.5 * length[seen]


def main() -> None:
    """Measure and print."""
    start()
    room, splats = room_of_splats(ROOMS[0])
    begin = time.perf_counter()
    mesh = mesh_of_splats(splats, SurfaceConfig(), len(available_cores()))
    seconds = time.perf_counter() - begin
    memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    errors = {ROOMS[0]: errors_of(mesh, room, places_in(splats))}
    taken_apart = [taken_apart_row(ROOMS[0], mesh)]
    for name in ROOMS[1:]:
        other, others = room_of_splats(name)
        found = mesh_of_splats(others, SurfaceConfig(), len(available_cores()))
        errors[name] = errors_of(found, other, places_in(others))
        taken_apart.append(taken_apart_row(name, found))
    fewer = splats.subset(np.random.default_rng(0).permutation(len(splats))[:FRAME_SPLATS])
    result = Measured(
        len(splats), len(mesh.faces), seconds, memory,
        {name: mean for name, (mean, _) in errors.items()}, {name: p95 for name, (_, p95) in errors.items()},
        frames_a_second(fewer, places_in(splats)[0]), likeness(splats, room.record.mesh),
        taken_apart,
    )  # fmt: skip
    sys.stdout.write(json.dumps(asdict(result)))


def taken_apart_row(name: str, mesh: Mesh) -> list[str]:
    """Row on the segmentation of the mesh of a room's splats."""
    room, scan = segments.read_room(name)
    return segments.rows_of(name, segments.both_ways(room, segments.on_mesh(scan, mesh)))


def room_of_splats(name: str) -> tuple[BuiltRoom, Gaussians]:
    """An embedded room, with about SPLATS splats on its surfaces."""
    room = build_room(name, 0)
    area = float(room.record.mesh.face_areas.sum())
    return room, splats_on_mesh(room.record.mesh, float(np.sqrt(area / SPLATS)), seed=0)


def places_in(splats: Gaussians) -> NDArray[np.float64]:
    """Viewpoints of the reconstruction [m], shape (k, 3)."""
    config = SurfaceConfig()
    return np.unique([c.position for c in viewpoints(splats, config.places, config.pixels)], axis=0)


def errors_of(mesh: Mesh, room: BuiltRoom, places: NDArray[np.float64]) -> tuple[float, float]:
    """Mean and 95th percentile of the distance from the visible furniture to the mesh, by area [m]."""
    distance, area = distances(mesh, room, places)
    order = np.argsort(distance)
    share = np.cumsum(area[order]) / area.sum()
    return float(np.average(distance, weights=area)), float(distance[order][np.searchsorted(share, 0.95)])


def distances(
    mesh: Mesh, room: BuiltRoom, places: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance from each visible face of furniture to the reconstructed mesh [m], and its area [m^2]."""
    middle, area = seen_furniture(room, places)
    return MeshDistance(mesh).unsigned(middle), area


def frames_a_second(splats: Gaussians, place: NDArray[np.float64]) -> float:
    """Pictures of 640 x 480 a second, turning around at a place."""
    splatter = Splatter(splats)
    angles = np.linspace(0.0, 2.0 * np.pi, FRAMES, endpoint=False)
    ahead = np.stack([np.cos(angles), np.sin(angles), np.full(FRAMES, -0.2)], axis=1)
    cameras = [looking_at(place, place + d, 640, 480, fov_deg=70.0) for d in ahead]
    splatter.view(cameras[0])
    begin = time.perf_counter()
    for camera in cameras:
        splatter.view(camera)
    return FRAMES / (time.perf_counter() - begin)


def likeness(splats: Gaussians, mesh: Mesh) -> float:
    """Mean peak signal-to-noise ratio of pictures of the splats against those of their mesh [dB]."""
    cameras = camera_path(splats, PathConfig(views=VIEWS, width=640, height=480)).cameras
    splatter, caster = Splatter(splats), Raycaster(mesh)
    pairs = ((np.clip(splatter.view(camera).image, 0.0, 1.0), unlit(mesh, camera, caster)) for camera in cameras)
    return float(np.mean([psnr(a, b) for a, b in pairs]))


if __name__ == "__main__":
    main()
