"""A finished placement of the ball on the bed of `dented_bed`, by formula: what the viewer is tried on."""

from dataclasses import replace

import numpy as np
import viser
from dented_bed import anchor, ball, box_mesh, scene_of, settled
from rest_records import history

from dcap.scene.types.choices import Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from flows.place import PlaceConfig
from flows.placement_json import Values, certificate_of
from flows.view.model import placement_view
from flows.view.nodes import PlacementNodes
from flows.view.panel import PanelText, PlacementPanel, signal_series
from solver.motion import BodyPath, DropFrames

FRAMES = 4
"""Start, falling, touching, at rest."""
TREE = {
    "verdict": "at_rest", "reason": None, "message": None, "prompt": "put <it> there",
    "base": {"id": "bed", "label": "bed"},
    "part": "body", "region": "center", "region_missed": False, "scale": 1.0, "mass": 0.3, "visible_fraction": 1.0,
    "contacts": [], "materials": [], "warnings": ["a & b"], "notes": [],
}  # fmt: skip


def moving() -> Settled:
    """The settled ball with frames: it falls evenly while the dent grows with the square of the time."""
    rest = settled()
    share = np.linspace(0.0, 1.0, FRAMES)
    ball_body, bed = rest.bodies
    half = 0.25 * share
    turn = np.stack([
        [[np.cos(2 * a), -np.sin(2 * a), 0.0], [np.sin(2 * a), np.cos(2 * a), 0.0], [0.0, 0.0, 1.0]] for a in half
    ])  # fmt: skip
    none = np.zeros((FRAMES, 0, 3), dtype=np.float32)
    fall = BodyPath(turn, share[:, None] * ball_body.position, np.zeros(0, dtype=np.int32), none)
    moved = np.flatnonzero(bed.displacement[:, 2]).astype(np.int32)
    dent = (share[:, None, None] ** 2 * bed.displacement[moved]).astype(np.float32)
    still = BodyPath(np.stack([np.eye(3)] * FRAMES), np.zeros((FRAMES, 3)), moved, dent)
    return replace(
        rest,
        frames=DropFrames(np.linspace(0.0, 0.1 * (FRAMES - 1), FRAMES, dtype=np.float64), (fall, still)),
        history=history(8),
    )


SLIDE = np.array([0.04, 0.0, 0.0])
"""How far the crate is pushed [m]."""


def pushed() -> tuple[Segmentation, Settled]:
    """A crate beside the ball that was placed before and slides evenly while the ball falls."""
    crate = box_mesh((0.3, -0.1, 0.5), (0.5, 0.1, 0.7))
    scene = scene_of(crate=crate)
    end = Mesh(crate.vertices + SLIDE, crate.faces, crate.colors)
    body = SettledBody("crate", end, SLIDE, np.array([1.0, 0, 0, 0]), np.tile(SLIDE, (len(crate.vertices), 1)))
    share = np.linspace(0.0, 1.0, FRAMES)[:, None]
    none = np.zeros((FRAMES, 0, 3), dtype=np.float32)
    path = BodyPath(np.stack([np.eye(3)] * FRAMES), share * SLIDE, np.zeros(0, dtype=np.int32), none)
    told = moving()
    assert told.frames is not None
    frames = replace(told.frames, bodies=(*told.frames.bodies, path))
    things = tuple(replace(one, placed=one.id == "crate") for one in scene.instances)
    return replace(scene, instances=things), replace(told, bodies=(*told.bodies, body), frames=frames)


def values(rest: Settled | None = None) -> Values:
    """What the stages would have returned."""
    return Values(
        scan=None, object_scan=None, scene=scene_of(), item=ball(), intent=None, anchor=anchor(), materials=None,
        particles=None, settled=rest or moving(), renders=None, infeasible=None,
    )  # fmt: skip


def shown(server: viser.ViserServer, found: Values | None = None) -> tuple[PlacementNodes, PlacementPanel]:
    """The ball on the bed, perhaps in another scene."""
    view = placement_view(found or values(), PlaceConfig())
    certificate = certificate_of(values())
    pictures = tuple(np.full((8, 8, 3), 40 * one, dtype=np.uint8) for one in range(3))
    rotation = Rotation(np.eye(3), pictures, "ball", "as read", "a ball has no up")
    rest = values().settled
    assert rest is not None
    signals = signal_series(rest, certificate)
    nodes = PlacementNodes(server, view)
    text = PanelText({**TREE, "certificate": certificate}, rotation, signals)
    return nodes, PlacementPanel(server, nodes, view, text)
