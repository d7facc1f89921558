"""Result of the mesh stage: one coloured mesh, its unit, its repairs, and facts from its source."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array, check_index
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.earlier import EarlierPlacements
from dcap.scene.types.mesh import Mesh

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Length of each unit [m], by its symbol."""
TAKEN_AS_METRES = {"centimetres": METRES["cm"], "inches": METRES["in"], "millimetres": METRES["mm"]}
"""Lengths that a file may use as if they were metres [m], by name."""


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
    """Index into `node_names` for each face, -1 for a face without a name in the source, shape (m,)."""
    node_names: tuple[str, ...]
    """Names of the nodes, groups or components of the source."""
    boxes: tuple[LabelBox, ...]
    """Annotated instances; empty if the source has none."""
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
    """Label of each node's instance in the source: `chair`; '' for none, None if not stated. The name of a labelled
    node is `instance id` or `instance id/part`. Empty: there are only names."""
    earlier: EarlierPlacements | None = None
    """Facts of a scene with things placed earlier, whose nodes are the instances. None without such things."""

    def __post_init__(self) -> None:
        check_index("face_node", self.face_node, length=len(self.mesh.faces), count=len(self.node_names))
        check_array("world_from_file", self.world_from_file, 4, 4)
        if len(self.node_labels) not in (0, len(self.node_names)):
            raise GeometryError(f"node_labels has {len(self.node_labels)} entries, expected {len(self.node_names)}")


class Method(StrEnum):
    """Surfaces from which distances are computed."""

    CLOSED = "closed surface"
    """The given faces and faces that close them."""
    WINDING = "faces, inside by winding number"
    """The given faces and, for a support, the columns under them: not a clean surface; sides are determined by
    counting."""
    COLUMNS = "columns under what is seen"
    """A closed surface of the faces visible from the descending object, and the columns under them."""
    REMESHED = "remeshed"
    """A surface meshed again from a sampled distance."""


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Report on the repair of one surface; lengths in metres."""

    method: Method
    """Surface from which distances are computed; `closed` and `agreement` are weaker for faces with winding numbers."""
    closed: bool
    """Whether every directed edge has its opposite; for a closed or meshed surface also whether no face is empty or
    duplicated, and the surface is wound outwards.
    """
    agreement: float
    """Share of points in and around the solid whose side is certain [-]: for a closed or meshed surface those whose
    winding number and ray parity agree; else those whose winding number is within 0.1 of a whole number.
    """
    hausdorff: float
    """Largest distance from the visible surface to the repaired one [m]."""
    mean: float
    """Mean of that distance over the visible surface [m]."""
    tolerance: float
    """Upper bound that `hausdorff` had to meet [m]."""
    spacing: float
    """Mean spacing of the points where the distance was measured, in addition to all vertices [m]."""
    volume: float
    """Enclosed volume [m^3]."""
    resolution: float
    """Cell of the remesh [m]; 0: the given faces were kept."""
    repairs: tuple[str, ...]
    """Repairs made, one sentence each."""
    problem: str
    """Reason why the surface is not a good solid; empty if it is."""
    region: tuple[float, ...] = ()
    """Lower and upper corner of the box in which `hausdorff` and `mean` were measured [m], six numbers; empty:
    everywhere."""


@dataclass(frozen=True, slots=True)
class BodyGeometry:
    """The repair report of one piece of one body of the drop."""

    body: str
    """Name of the simulated body."""
    part: str
    """Name of the body's part or parts."""
    report: RepairReport


@dataclass(frozen=True, slots=True)
class FileScale:
    """Length of a file's unit, and its reason."""

    metres: float
    """Length of the file's unit [m]."""
    note: str
    """Origin of the length, as a sentence."""
