"""Pictures of a mesh in its own colours, without light: what splats on it should look like; and how alike two are."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

F32 = NDArray[np.float32]

SAMPLES = 2
"""Rays along each side of a pixel, so that edges are as smooth as in other pictures [-]."""


def unlit(mesh: Mesh, camera: Camera, caster: Raycaster | None = None) -> F32:
    """sRGB 0 to 1 over black, shape (rows, columns, 3); `caster` is the mesh's, if there is one already."""
    fine = camera.scaled(SAMPLES)
    ways = fine.directions(fine.pixel_centers)
    hits = (caster or Raycaster(mesh)).cast(np.broadcast_to(camera.position, ways.shape), ways)
    seen = hits.face >= 0
    color = np.zeros((len(ways), 3))
    corners = mesh.colors[mesh.faces[hits.face[seen]]] / 255.0
    color[seen] = np.einsum("nk,nkc->nc", hits.barycentric[seen], corners)
    blocks = color.reshape(camera.height, SAMPLES, camera.width, SAMPLES, 3)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float32)


def psnr(a: F32, b: F32) -> float:
    """Peak signal-to-noise ratio of two pictures with colours 0 to 1 [dB], inf where they are equal."""
    error = float(np.mean((a.astype(np.float64) - b) ** 2))
    return float("inf") if error == 0.0 else -10.0 * float(np.log10(error))
