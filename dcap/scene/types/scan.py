"""Result of the mesh stage: one coloured mesh and facts from its source."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array, check_index
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.earlier import EarlierPlacements
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class LabelBox:
    """A labelled instance box as annotated in the source (InteriorGS labels.json)."""

    id: str
    label: str
    box: OrientedBox


@dataclass(frozen=True, eq=False, slots=True)
class Room:
    """A floor polygon."""

    kind: str
    profile: NDArray[np.float64]
    """Corners [m], shape (k, 2)."""

    def __post_init__(self) -> None:
        check_array("profile of a room", self.profile, None, 2)


@dataclass(frozen=True, eq=False, slots=True)
class Scan:
    """A scene or an object, in metres, right-handed, z up."""

    mesh: Mesh
    face_node: NDArray[np.int32]
    """Index into `node_names` for each face, -1 without a name in the source, shape (m,)."""
    node_names: tuple[str, ...]
    """Names of the nodes, groups or components of the source."""
    boxes: tuple[LabelBox, ...]
    """Annotated instances; empty when the source has none."""
    rooms: tuple[Room, ...]
    label: str
    """Label of the whole mesh (option --label, or the file's stem); empty for a labelled scene."""
    world_from_file: NDArray[np.float64]
    """Maps the file's own coordinates to ours, shape (4, 4)."""
    up: str
    """Axis of the file that points up: y, z, -y or -z."""
    unit_metres: float
    """Length of the file's unit [m]."""
    unit_source: str
    """Source of the unit: option, format or estimate."""
    notes: tuple[str, ...]
    """Repairs, assumptions and ignored parts on reading, one sentence each."""
    node_labels: tuple[str | None, ...] = ()
    """Label of each node's instance in the source: `chair`; '' for none, None if not stated. Such a node is called
    `instance id` or `instance id/part`. Empty: there are only names."""
    earlier: EarlierPlacements | None = None
    """Facts of a scene with earlier placed things, whose nodes are the instances. None without such things."""

    def __post_init__(self) -> None:
        check_index("face_node", self.face_node, length=len(self.mesh.faces), count=len(self.node_names))
        check_array("world_from_file", self.world_from_file, 4, 4)
        if len(self.node_labels) not in (0, len(self.node_names)):
            raise GeometryError(f"node_labels has {len(self.node_labels)} entries, expected {len(self.node_names)}")
