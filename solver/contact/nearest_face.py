"""The face of a surface nearest to a point: exact, and searched only where it matters.

In: labelled triangles. Out: the label of the face nearest to each point. A point near a vertex whose adjacent faces all
have the same label needs no search; other points are compared with the faces that can be nearest [E05, Sec. 5.1.5].

[E05] Ericson: Real-Time Collision Detection. Morgan Kaufmann 2005.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.arrays import Array, IntArray


@dataclass(frozen=True, eq=False, slots=True)
class FaceGroup:
    """Faces of similar size."""

    face: IntArray
    """Indices of the faces, shape (k,)."""
    middle: cKDTree
    """Search tree of their middles."""
    radius: float
    """Largest distance of a corner from the middle of its face [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class NearestFace:
    """A labelled surface, prepared for many points, almost all of which lie near the same vertices."""

    triangles: Array
    """Corners [m], shape (m, 3, 3)."""
    label: IntArray
    """Label of each face, shape (m,)."""
    groups: tuple[FaceGroup, ...]
    vertices: cKDTree
    vertex_label: IntArray
    """Label of the faces around each vertex, shape (n,)."""
    others: dict[int, tuple[FaceGroup, ...]]
    """For each label the faces of all other labels; made on demand."""
    clear: Array
    """Lower bound of the distance from each vertex to a face of another label [m], shape (n,); NaN until it is
    needed."""

    @classmethod
    def of(cls, vertices: Array, faces: NDArray[np.int32], label: IntArray) -> "NearestFace":
        """Prepare a surface with a label for each face (m,)."""
        triangles, used = vertices[faces], np.unique(faces)
        place = np.searchsorted(used, faces)
        vertex_label = np.zeros(len(used), dtype=np.int64)
        vertex_label[place.ravel()] = np.repeat(label, 3)
        groups = groups_of(triangles, np.arange(len(faces)))
        return cls(triangles, label, groups, cKDTree(vertices[used]), vertex_label, {}, np.full(len(used), np.nan))

    def label_at(self, point: Array) -> IntArray:
        """Label of the face nearest to each point (k, 3), shape (k,)."""
        away, vertex = self.vertices.query(point)
        label = self.vertex_label[vertex]
        # the nearest face is no farther than the vertex, so it is within twice that distance of the vertex
        unsure = np.flatnonzero(2.0 * away >= self.clear_of(vertex))
        if len(unsure):
            label[unsure] = self.label[self.nearest(point[unsure])]
        return np.asarray(label)

    def clear_of(self, vertex: IntArray) -> Array:
        """The values of `clear` for some vertices (k,)."""
        new = np.unique(vertex[np.isnan(self.clear[vertex])])
        for one in np.unique(self.vertex_label[new]).tolist():
            mine = new[self.vertex_label[new] == one]
            if one not in self.others:
                self.others[one] = groups_of(self.triangles, np.flatnonzero(self.label != one))
            place = np.asarray(self.vertices.data)[mine]
            self.clear[mine] = np.inf
            for group in self.others[one]:
                self.clear[mine] = np.minimum(self.clear[mine], group.middle.query(place)[0] - group.radius)
        return np.asarray(self.clear[vertex])

    def nearest(self, point: Array) -> IntArray:
        """Index of the face nearest to each point (k, 3), the first on a tie, shape (k,)."""
        best = np.full(len(point), np.inf)
        for group in self.groups:
            first = group.face[group.middle.query(point)[1]]
            best = np.minimum(best, distances(point, self.triangles[first]))
        pairs = [near(group, point, best) for group in self.groups]
        row, face = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
        order = np.lexsort((face, distances(point[row], self.triangles[face]), row))
        return np.asarray(face[order[np.unique(row[order], return_index=True)[1]]])


def groups_of(triangles: Array, chosen: IntArray) -> tuple[FaceGroup, ...]:
    """The chosen faces (k,), grouped by powers of two of their size."""
    middle = triangles[chosen].mean(axis=1)
    radius = np.linalg.norm(triangles[chosen] - middle[:, None], axis=2).max(axis=1)
    power = np.ceil(np.log2(np.maximum(radius, np.finfo(float).tiny)))
    return tuple(
        FaceGroup(chosen[power == one], cKDTree(middle[power == one]), float(radius[power == one].max()))
        for one in np.unique(power)
    )


def near(group: FaceGroup, point: Array, reach: Array) -> tuple[IntArray, IntArray]:
    """Pairs of row indices: of a point (k, 3) and of a face of the group that may lie within the point's reach (k,)
    [m]."""
    found = group.middle.query_ball_point(point, reach * (1.0 + 1e-9) + group.radius)
    row = np.repeat(np.arange(len(point)), [len(one) for one in found])
    return row, group.face[np.array([face for one in found for face in one], dtype=np.int64)]


def distances(point: Array, triangle: Array) -> Array:
    """Distance of each point (k, 3) to its triangle (k, 3, 3) [m], shape (k,): to the plane if the foot point lies in
    the triangle, else to the nearest edge."""
    a, b, c = triangle.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
    edges = [(a, b), (b, c), (c, a)]
    within = np.stack([dot(np.cross(normal, q - p), point - p) >= 0.0 for p, q in edges]).all(axis=0)
    to_edge = np.min([edge_distances(point, p, q) for p, q in edges], axis=0)
    return np.asarray(
        np.where(within & (length > np.finfo(float).tiny), np.abs(dot(normal, point - a)) / length, to_edge)
    )


def edge_distances(point: Array, p: Array, q: Array) -> Array:
    """Distance of each point (k, 3) to the segment from p to q [m], shape (k,)."""
    along = q - p
    share = np.clip(dot(point - p, along) / np.maximum(dot(along, along), np.finfo(float).tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(point - p - share[:, None] * along, axis=1))


def dot(a: Array, b: Array) -> Array:
    """Dot products row by row, shape (k,)."""
    return np.asarray(np.einsum("ij,ij->i", a, b))
