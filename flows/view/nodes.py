"""Draws a placement in a viser scene: one node per part of the room, the object, the dent, and the marks.

Nodes: `/room/ID/PART`, below it `dent/FRAME` if it bends; `/object/FRAME`; `/contact`, `/anchor/...`,
`/ray`, `/particles/...`. The page gets the shapes of all frames at once and shows one of them: a shape sent later
would be missing until the page has read it.
"""

import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from flows.view.model import MaterialCloud, PlacementView, RoomPiece, StartView, heat_colors, still
from flows.view.page_glb import PageSurface, glb_of
from flows.view.surface import DrawnSurface

ANCHOR_COLOR, NORMAL_COLOR, RAY_COLOR, CONTACT_COLOR = (230, 30, 120), (40, 90, 220), (240, 140, 20), (255, 90, 20)
ENVIRONMENT = 0.35
"""Strength of the ambient light [-], in addition to viser's own light from above."""


@dataclass(frozen=True, eq=False, slots=True)
class PieceNode:
    """A part of the room in the scene."""

    piece: RoomPiece
    node: viser.SceneNodeHandle
    dents: list[viser.GlbHandle]
    """Its bending faces at each shown frame; empty: it does not bend."""


class PlacementNodes:
    """The nodes of a placement; `show_frame` moves them to a frame."""

    def __init__(self, server: viser.ViserServer, view: PlacementView, frame: int | None = None) -> None:
        self._server, self._scene, self.view = server, server.scene, view
        self._lock = threading.Lock()
        self.frame = len(view.time) - 1 if frame is None else frame
        set_light(self._scene)
        self.pieces = [add_piece(self._scene, one, view, self.frame) for one in view.pieces]
        self.thing, self._shapes = self._thing_nodes()
        self.contact = self._contact_node()
        self.anchor, self.ray = self._anchor_nodes()
        self.clouds = [add_cloud(self._scene, number, one) for number, one in enumerate(view.clouds)]
        self._move()

    def show_frame(self, frame: int) -> None:
        """Move all moving nodes to a frame."""
        with self._lock, self._server.atomic():
            before, self.frame = self.frame, int(np.clip(frame, 0, len(self.view.time) - 1))
            if before == self.frame:
                return
            for row in [*(one.dents for one in self.pieces), self._shapes]:
                if len(row) > 1:
                    row[self.frame].visible = True
                    row[before].visible = False
            self._move()

    def show_heat(self, on: bool) -> None:
        """Colour the base by its displacement."""
        view = self.view
        if view.bending is None:
            return
        with self._lock:
            mine = [one for one in self.pieces if one.piece.instance == view.base_id]
            for one in mine:
                if isinstance(one.node, viser.GlbHandle):
                    one.node.glb_data = glb_of(still(one.piece.surface) if on else one.piece.surface)
            for one in mine:
                for dent, data in zip(one.dents, glbs_of(self._bent(one.piece, heat=on)), strict=True):
                    dent.glb_data = data

    def show_clouds(self, on: bool) -> None:
        """Show the material points."""
        for one in self.clouds:
            one.visible = on

    def _bent(self, piece: RoomPiece, *, heat: bool) -> Iterator[DrawnSurface]:
        """The bending faces of a part at each frame."""
        view = self.view
        assert view.bending is not None
        for frame in view.frames.tolist() if piece.bends is not None else ():
            assert piece.bends is not None
            colors = heat_colors(view.bending.heights(frame, view.base_id), view.span) if heat else None
            yield view.bending.surface(frame, piece.bends, colors)

    def _move(self) -> None:
        """Set the poses of rigidly moving nodes."""
        frame = int(self.view.frames[self.frame])
        if self.view.thing is not None and self.thing is not None:
            set_pose(self.thing, self.view.thing.poses[frame])
        for one in self.pieces:
            if one.piece.poses is not None:
                set_pose(one.node, one.piece.poses[frame])

    def _thing_nodes(self) -> tuple[viser.FrameHandle | None, list[viser.GlbHandle]]:
        """Add the object, with its shape at every frame or its only one."""
        thing = self.view.thing
        if thing is None:
            return None, []
        node = self._scene.add_frame("/object", show_axes=False)
        frames = self.view.frames.tolist() if thing.deforms else [0]
        files = glbs_of(thing.surface(frame) for frame in frames)
        return node, [
            self._scene.add_glb(f"/object/{number}", data, visible=len(frames) == 1 or number == self.frame)
            for number, data in enumerate(files)
        ]

    def _contact_node(self) -> viser.PointCloudHandle | None:
        contact = self.view.contact
        if contact is None:
            return None
        return self._scene.add_point_cloud(
            "/contact", contact.points, CONTACT_COLOR, point_size=contact.size, point_shape="circle",
            precision="float32", point_shading="flat",
        )  # fmt: skip

    def _anchor_nodes(self) -> tuple[viser.FrameHandle | None, viser.LineSegmentsHandle | None]:
        """Add the anchor point with its normal, and the vertical ray."""
        mark = self.view.anchor
        if mark is None:
            return None, None
        node = self._scene.add_frame("/anchor", show_axes=False)
        self._scene.add_icosphere("/anchor/point", 0.04 * mark.reach, color=ANCHOR_COLOR, position=mark.point)
        tip = mark.point + mark.reach * mark.normal
        self._scene.add_arrows(
            "/anchor/normal", np.stack([mark.point, tip])[None].astype(np.float32), NORMAL_COLOR,
            shaft_radius=0.015 * mark.reach, head_radius=0.04 * mark.reach, head_length=0.12 * mark.reach,
        )  # fmt: skip
        ray = self._scene.add_line_segments(
            "/ray", np.stack([mark.above, mark.point])[None].astype(np.float32), RAY_COLOR, thickness=3.0
        )
        return node, ray


def set_light(scene: viser.SceneApi) -> None:
    """Set up even ambient light and shadows from above: a scan has its own shadows in its colours."""
    scene.set_up_direction("+z")
    scene.configure_environment_map("studio", environment_intensity=ENVIRONMENT)


def place_cameras(server: viser.ViserServer, view: StartView) -> None:
    """Place the camera of new pages, and of those that are open."""
    up, fov = (0.0, 0.0, 1.0), float(np.radians(view.fov_deg))
    first = server.initial_camera
    first.up, first.fov, first.position, first.look_at = up, fov, view.position, view.target
    for client in server.get_clients().values():
        with client.atomic():
            one = client.camera
            one.up_direction, one.fov, one.position, one.look_at = up, fov, view.position, view.target


def piece_path(instance: str, part: str, number: int) -> str:
    """Name of the node of a part."""
    name = f"{part}_{number}" if part else "rest"
    return f"/room/{plain(instance)}/{plain(name)}"


def plain(name: str) -> str:
    """A name without the separator of nodes."""
    return name.replace("/", "_") or "_"


def add_piece(scene: viser.SceneApi, piece: RoomPiece, view: PlacementView, shown: int = 0) -> PieceNode:
    """Add a part of the room with its bending faces at every frame, one of them visible. A structure is drawn from
    inside only and casts no shadow into the room."""
    path, node = piece_path(piece.instance, piece.part, piece.number), None
    if len(piece.surface.mesh.faces):
        data = glb_of(piece.surface, both_sides=not piece.structure)
        node = scene.add_glb(path, data, cast_shadow=not piece.structure)
    bent: Iterable[DrawnSurface] = ()
    if piece.bends is not None and view.bending is not None:
        bent = (view.bending.surface(frame, piece.bends) for frame in view.frames.tolist())
    parent = node or scene.add_frame(path, show_axes=False)
    dents = [
        scene.add_glb(f"{path}/dent/{number}", data, cast_shadow=not piece.structure, visible=number == shown)
        for number, data in enumerate(glbs_of(bent))
    ]
    return PieceNode(piece, parent, dents)


def glbs_of(surfaces: Iterable[DrawnSurface]) -> Iterator[bytes]:
    """GLB files of the same faces at several frames."""
    page: PageSurface | None = None
    for one in surfaces:
        page = page or PageSurface(one)
        yield page.glb(one)


def set_pose(node: viser.SceneNodeHandle, pose: NDArray[np.float64]) -> None:
    """Give a node a pose (4, 4)."""
    node.wxyz = Turn.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
    node.position = pose[:3, 3]


def add_cloud(scene: viser.SceneApi, number: int, cloud: MaterialCloud) -> viser.PointCloudHandle:
    """Add material points, initially hidden."""
    points: NDArray[np.float32] = cloud.points
    return scene.add_point_cloud(
        f"/particles/{plain(cloud.body)}/{number}_{plain(cloud.material)}", points, cloud.color,
        point_size=cloud.size, point_shape="circle", precision="float32", visible=False,
    )  # fmt: skip
