"""Points on surfaces of known shape, and files of them in every format that is read."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.splatting.discs import even_points
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import PointCloud


def points_on(mesh: Mesh, count: int, *, noise: float = 0.0, seed: int = 0) -> PointCloud:
    """Points spread evenly over a mesh with its colours and normals, off it by the standard deviation `noise` [m]."""
    random = np.random.default_rng(seed)
    face, weight = even_points(mesh.face_areas, count, random)
    normal = mesh.face_normals[face]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    position = np.einsum("nk,nki->ni", weight, mesh.corners(face)) + noise * random.standard_normal((count, 3))
    color = np.einsum("nk,nkc->nc", weight, mesh.colors[mesh.faces[face]].astype(np.float64))
    return PointCloud(position, np.rint(color).astype(np.uint8), normal)


def without_normals(cloud: PointCloud) -> PointCloud:
    """The same points."""
    return PointCloud(cloud.position, cloud.color)


def write_ply_points(path: Path, cloud: PointCloud) -> Path:
    """Binary, without an element of faces."""
    columns: list[tuple[str, NDArray[np.generic], str, str]]
    columns = [(name, cloud.position[:, k], "<f8", "double") for k, name in enumerate("xyz")]
    if cloud.normal is not None:
        columns += [(f"n{name}", cloud.normal[:, k], "<f4", "float") for k, name in enumerate("xyz")]
    columns += [(name, cloud.color[:, k], "u1", "uchar") for k, name in enumerate(("red", "green", "blue"))]
    rows = np.empty(len(cloud), dtype=[(name, kind) for name, _, kind, _ in columns])
    for name, values, _, _ in columns:
        rows[name] = values
    lines = [f"property {said} {name}" for name, _, _, said in columns]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}", *lines, "end_header", ""]
    path.write_bytes("\n".join(header).encode() + rows.tobytes())
    return path


def write_pcd(path: Path, cloud: PointCloud, *, encoding: str = "binary", height: int = 1) -> Path:
    """`ascii` or `binary`; colours are packed into the bytes of a float, as the format has it."""
    names, kinds = ["x", "y", "z"], ["<f8"] * 3
    packed = (cloud.color.astype(np.uint32) << np.array([16, 8, 0], dtype=np.uint32)).sum(axis=1, dtype=np.uint32)
    values: list[NDArray[np.generic]] = list(cloud.position.T)
    if cloud.normal is not None:
        names += [f"normal_{axis}" for axis in "xyz"]
        kinds += ["<f4"] * 3
        values += list(cloud.normal.T)
    names, kinds, values = [*names, "rgb"], [*kinds, "<u4"], [*values, packed]
    rows = np.empty(len(cloud), dtype=list(zip(names, kinds, strict=True)))
    for name, column in zip(names, values, strict=True):
        rows[name] = column
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(names)}\nSIZE {' '.join(kind[2] for kind in kinds)}\n"
        f"TYPE {' '.join(kind[1].upper() for kind in kinds)}\nCOUNT {' '.join('1' for _ in names)}\n"
        f"WIDTH {len(cloud) // height}\nHEIGHT {height}\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(cloud)}\nDATA {encoding}\n"
    )
    data = rows.tobytes() if encoding == "binary" else "".join(
        " ".join(repr(one) for one in row) + "\n" for row in rows.tolist()
    ).encode()  # fmt: skip
    path.write_bytes(header.encode() + data)
    return path


def rows_of(cloud: PointCloud, *, shares: bool = False) -> Array:
    """x y z, colours and normals in columns (n, 6) or (n, 9); `shares`: colours from 0 to 1."""
    color = cloud.color / 255.0 if shares else cloud.color.astype(np.float64)
    return np.hstack([cloud.position, color, *([] if cloud.normal is None else [cloud.normal])])


def write_xyz(path: Path, cloud: PointCloud, *, shares: bool = False) -> Path:
    """Text of x y z r g b and normals."""
    np.savetxt(path, rows_of(cloud, shares=shares), fmt="%.9g")
    return path


def write_pts(path: Path, cloud: PointCloud) -> Path:
    """A count, then x y z intensity r g b."""
    rows = np.hstack([cloud.position, np.full((len(cloud), 1), 120.0), cloud.color])
    np.savetxt(path, rows, fmt="%.9g", header=str(len(cloud)), comments="")
    return path


def write_npy(path: Path, cloud: PointCloud) -> Path:
    """One array."""
    np.save(path, rows_of(cloud))
    return path


def write_npz(path: Path, cloud: PointCloud) -> Path:
    """Arrays by name."""
    if cloud.normal is None:
        np.savez(path, points=cloud.position, colors=cloud.color / 255.0)
    else:
        np.savez(path, points=cloud.position, colors=cloud.color / 255.0, normals=cloud.normal)
    return path


WRITERS: dict[str, Callable[[Path, PointCloud], Path]] = {
    "a.ply": write_ply_points, "a.pcd": write_pcd,
    "b.pcd": lambda path, cloud: write_pcd(path, cloud, encoding="ascii"),
    "a.xyz": write_xyz, "a.xyzrgb": lambda path, cloud: write_xyz(path, cloud, shares=True), "a.pts": write_pts,
    "a.npy": write_npy, "a.npz": write_npz,
}  # fmt: skip
"""What writes a file of this name."""
