"""The contact points' part of the linear system: J^T T J by products with J, which has few entries."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.contact.active import Contacts
from solver.model.state import cross_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class ContactMap:
    """J: displacement of each point's body relative to the other one, from displacements of nodes and frames."""

    nodes: sparse.csr_matrix
    """The same weights for each direction, shape (k, n)."""
    frames: Array
    """Shape (k, 3, 6 b)."""
    tangent: Array
    """T, force per relative displacement at each point, shape (k, 3, 3)."""

    @classmethod
    def of(cls, contacts: Contacts, nodes: int, place: dict[int, int], center: Array) -> "ContactMap":
        """Of the points' own weights for nodes; `place` gives the frame of each rigid body, `center` (b, 3) those
        frames' reference points [m]."""
        count = len(contacts.a)
        frames = np.zeros((count, 3, len(center), 6))
        for body, f in place.items():
            for which, sign in ((contacts.a, 1.0), (contacts.b, -1.0)):
                points = np.flatnonzero(which == body)
                frames[points, :, f, :3] += sign * np.eye(3)
                frames[points, :, f, 3:] -= sign * cross_matrix(contacts.position[points] - center[f])
        return cls(contacts.gather[:, :nodes], frames.reshape(count, 3, 6 * len(center)), contacts.tangent)

    def add_forces(self, force: Array, nodes: Array, frames: Array) -> None:
        """Add J^T f of forces (k, 3) to those on nodes (n, 3) and frames (b, 6)."""
        if nodes.size:
            nodes += self.nodes.T @ force
        if frames.size:
            frames += np.tensordot(force, self.frames, axes=((0, 1), (0, 1))).reshape(frames.shape)

    def add_product(self, move: tuple[Array, Array], out: tuple[Array, Array]) -> None:
        """Add J^T T J times a motion of nodes (n, 3) and frames (b, 6)."""
        nodes, frames = move
        relative = self.nodes @ nodes if nodes.size else np.zeros((len(self.tangent), 3))
        if frames.size:
            relative += self.frames @ frames.ravel()
        self.add_forces(np.einsum("kij,kj->ki", self.tangent, relative), *out)

    def node_blocks(self) -> Array:
        """Blocks of J^T T J on the diagonal of each node, shape (n, 9)."""
        return np.asarray(self.nodes.multiply(self.nodes).T @ self.tangent.reshape(-1, 9))

    def of_frames(self) -> tuple[Array, Array]:
        """T J of the frames, shape (k, 3, 6 b), and J^T T J between them, shape (6 b, 6 b)."""
        pushed = np.asarray(self.tangent @ self.frames)
        return pushed, np.asarray(np.tensordot(self.frames, pushed, axes=((0, 1), (0, 1))))
