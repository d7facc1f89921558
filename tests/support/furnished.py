"""Files of small things and furniture for whole placements: what a scan shows of them, with named parts."""

from pathlib import Path

import numpy as np
import trimesh

from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.meshes import write_object

Span = tuple[float, float]
Parts = dict[str, Mesh]


def sheet(x: Span, y: Span, z: float, edge: float = 0.04) -> Mesh:
    """A level sheet that looks up, of squares of about `edge` [m]."""
    u, v = (np.linspace(*span, max(2, round((span[1] - span[0]) / edge) + 1)) for span in (x, y))
    corner = np.arange(len(u) * len(v)).reshape(len(u), len(v))
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    points = np.stack([*np.meshgrid(u, v, indexing="ij"), np.full((len(u), len(v)), z)], axis=-1).reshape(-1, 3)
    return Mesh.of(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def walls(x: Span, y: Span, z: Span, edge: float = 0.04) -> Mesh:
    """The four upright sides of a block, looking outwards."""
    solid = block(x, y, z)
    upright = np.flatnonzero(np.abs(solid.face_normals[:, 2]) < 1e-9)
    return subdivide_near(solid.submesh(upright), solid.bounds, edge)


def block(x: Span, y: Span, z: Span) -> Mesh:
    """A closed box."""
    solid = trimesh.creation.box(bounds=np.array([x, y, z]).T)
    return Mesh.of(solid.vertices, solid.faces)


def ball(radius: float) -> Mesh:
    """A closed ball about the origin."""
    solid = trimesh.creation.icosphere(4, radius)
    return Mesh.of(solid.vertices, solid.faces)


def pillar(radius: float, z: Span) -> Mesh:
    """A closed upright cylinder about the z axis."""
    solid = trimesh.creation.cylinder(radius=radius, height=z[1] - z[0], sections=48)
    solid.apply_translation((0.0, 0.0, 0.5 * (z[0] + z[1])))
    return Mesh.of(solid.vertices, solid.faces)


def bed(top: float, thick: float, blanket: float) -> Parts:
    """What one sees of a bed 1.4 x 2 m: a bare mattress at its head (y < -0.6), else a blanket that is `blanket` [m]
    higher and hangs down its sides, and the frame below; `top` is that of the mattress, `thick` its thickness [m]."""
    x, y, bare, bottom = (-0.7, 0.7), (-1.0, 1.0), -0.6, top - thick
    mattress = [sheet(x, (y[0], bare), top), walls(x, y, (bottom, top))]
    covered = [sheet(x, (bare, y[1]), top + blanket), walls(x, (bare, y[1]), (top, top + blanket))]
    frame = block((-0.75, 0.75), (-1.05, 1.05), (0.0, bottom))
    return {"mattress": Mesh.concatenate(mattress), "blanket": Mesh.concatenate(covered), "frame": frame}


def joined(meshes: list[Mesh]) -> Mesh:
    """One mesh of many."""
    return Mesh.concatenate(meshes)


def bare_bed(top: float, thick: float) -> Parts:
    """The same bed without its blanket."""
    x, y, bottom = (-0.7, 0.7), (-1.0, 1.0), top - thick
    mattress = joined([sheet(x, y, top), walls(x, y, (bottom, top))])
    return {"mattress": mattress, "frame": block((-0.75, 0.75), (-1.05, 1.05), (0.0, bottom))}


def rug(thick: float) -> Parts:
    """A rug 2 x 1.4 m whose top is at `thick` [m], on a floor that is seen around it."""
    x, y = (-1.0, 1.0), (-0.7, 0.7)
    floor = [sheet((-2.0, 2.0), span, 0.0) for span in ((-2.0, y[0]), (y[1], 2.0))]
    floor += [sheet(span, y, 0.0) for span in ((-2.0, x[0]), (x[1], 2.0))]
    return {"rug": joined([sheet(x, y, thick), walls(x, y, (0.0, thick))]), "floor": joined(floor)}


def written(path: Path, parts: Parts) -> Path:
    """The file of these parts, one named node each."""
    write_object(path, list(parts.items()))
    return path


def sofa(seat: float, thick: float) -> Parts:
    """A seat cushion 1.2 x 0.7 m, in one piece and `thick` [m], its top at `seat` [m], on a base and before a back."""
    base = block((-0.65, 0.65), (-0.4, 0.4), (0.0, seat - thick))
    back = block((-0.65, 0.65), (0.35, 0.5), (0.0, seat + 0.4))
    cushion = Mesh.concatenate([sheet((-0.6, 0.6), (-0.35, 0.35), seat),
                                walls((-0.6, 0.6), (-0.35, 0.35), (seat - thick, seat))])  # fmt: skip
    return {"base": base, "seat cushion": cushion, "back": back}


def table(top: float) -> Parts:
    """A wooden table 1.2 x 0.8 m whose top is 4 cm thick."""
    legs = [
        block((x - 0.03, x + 0.03), (y - 0.03, y + 0.03), (0.0, top - 0.04)) for x in (-0.5, 0.5) for y in (-0.3, 0.3)
    ]
    return {"top": block((-0.6, 0.6), (-0.4, 0.4), (top - 0.04, top)), "leg": Mesh.concatenate(legs)}
