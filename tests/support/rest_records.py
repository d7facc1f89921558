"""A certificate, contact and history with every kind of row, for tests that need some drop's records."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.mesh import AlphaMode, MaterialMap, Mesh, Paint, SourceSurface, SurfaceMaterial
from dcap.scene.types.pictures import Renders, Visibility
from dcap.scene.types.settled import LastState, PlacementChecks, Settled, SettledBody
from solver.certificate import (
    BodyStability,
    Certificate,
    CertificateRow,
    ContactRow,
    History,
    KickCheck,
    KickRow,
    NotDone,
    PushBounds,
    PushRow,
    RollingRow,
    SignalRows,
    StabilityGrade,
    Verdict,
)
from solver.motion import BodyPath, DropFrames, MaterialState

ROW = CertificateRow.at_most(1e-5, 1e-3)
KICK = KickCheck(
    stable=True, speed_m_s=1e-3, angular_speed_rad_s=1e-2, seconds=0.5, steps=12, growing=False,
    speed_left=KickRow(0.0, 0.5), distance_m=KickRow(1e-6, 1e-4, 2e-5),
    angle_rad=KickRow(0.0, 1.0),
)  # fmt: skip
PUSHES = (
    PushRow((1.0, 0.0, 0.0), 0.5, 0.52, 7, float("inf"), None),
    PushRow((0.0, 1.0, 0.0), 1.26, None, 6, None, None),
)
STABILITY = StabilityGrade(
    grade=0.5,
    bodies={"object": BodyStability(0.5, PUSHES)},
    trials=13,
    steps=400,
    bounds=PushBounds(0.05, 0.087, 0.02),
)
CHECKS = PlacementChecks(CertificateRow.at_least(1.0, 0.5), tilt_rad=ROW)
CONTACT = ContactRow("object", "bed", 1e-3, 9.81, 0.1, 5e-5, float("inf"), 12, 3)


def signals(row: CertificateRow = ROW) -> SignalRows:
    """Every signal with the same row."""
    return SignalRows(row, row, row, row, row, row, row)


def implicit_certificate() -> Certificate:
    """As tl writes it, with everything that can be asked for."""
    return Certificate(
        arch="cpu", signals=signals(), kick=KICK, free_weight_n=9.81, length_m=0.2, newton_residual=1e-4,
        friction_cone_margin=0.9, inverted_particles=0, unlocated_points=0, material_damping_s=0.01, depth_error_m=1e-4,
        rolling_resistance=(RollingRow("object", "bed", 1e-4, 1e-3),), stability=STABILITY,
    )  # fmt: skip


def explicit_certificate() -> Certificate:
    """As mls writes it."""
    return Certificate(
        arch="cpu", method="mls", signals=signals(), kick=NotDone(), free_weight_n=9.81, length_m=0.2,
        friction_cone_margin=0.9, inverted_particles=0, cell_m=0.01, substeps=4000, inertia_scale=90.0, interval_s=8e-3,
    )  # fmt: skip


def history(steps: int) -> History:
    """Signals that die out over `steps` steps."""
    series, counts = np.linspace(1.0, 0.0, steps), np.arange(steps)
    return History(series, series, series, series, series, series, counts, counts)


PATH = BodyPath(np.stack([np.eye(3)] * 2), np.zeros((2, 3)), np.array([4], np.int32), np.ones((2, 1, 3), np.float32))
STRESSED = MaterialState(np.zeros((2, 3)), np.ones((2, 3)), np.ones(2), np.ones(2), np.zeros((2, 6)))
FRAMES = DropFrames(np.array([0.0, 0.1]), (PATH,))
LAST = LastState(
    explicit_certificate(), (CONTACT,), np.zeros(3), np.array([1.0, 0, 0, 0]), 12, 0.5, ("still moving",), CHECKS
)  # fmt: skip


def settled_record(mesh: Mesh) -> Settled:
    """A rest state of one body with this surface of 60 vertices, with all that may be known of it."""
    body = SettledBody("object", mesh, np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros((60, 3)))
    return Settled(
        Verdict.AT_REST, (body,), (CONTACT,), np.zeros((0, 3)), implicit_certificate(), history(200), 200, 1.5, (),
        CHECKS, FRAMES, (STRESSED,), (np.zeros((3, 3), np.float32),),
    )  # fmt: skip


def painted_records(picture: NDArray[np.uint8]) -> tuple[object, ...]:
    """A textured surface and its paint, pictures and what is seen in them."""
    uv = np.linspace(0.0, 1.0, 6).reshape(1, 3, 2)
    paint = Paint(np.full((1, 3), 200, np.uint8), np.zeros(1, np.int32), uv, (picture,))
    seen = Visibility(np.ones((3, 4)), 0.25)
    renders = Renders(picture, picture, picture, 0.75, np.zeros(3), np.ones(3), picture, picture, picture, seen)
    triangle = Mesh.of(np.eye(3), [[0, 1, 2]])
    part = MaterialMap(1, 1, 0.5)
    said = SurfaceMaterial("glass", AlphaMode.MASK, 0.25, 0.5, 0.0, None, (0.1, 0.2, 0.3), False, normal_map=part)
    clear = np.dstack([picture, picture[..., 0]])
    full = replace(paint, textures=(clear, picture), face_material=np.zeros(1, np.int32), materials=(said,),
                   more_uv=(uv,))  # fmt: skip
    return paint, full, part, said, SourceSurface(triangle, full), SourceSurface.untextured(), seen, renders
