"""A certificate, contact and history with every kind of row, for tests that need some drop's records."""

import numpy as np

from dcap.scene.types.certificate import (
    PlacementChecks,
    SettledBodyStability,
    SettledCertificate,
    SettledContact,
    SettledKick,
    SettledKickRow,
    SettledPush,
    SettledPushBounds,
    SettledRolling,
    SettledRow,
    SettledSignals,
    SettledStability,
    SkippedCheck,
)
from dcap.scene.types.settled import SettledHistory

ROW = SettledRow.at_most(1e-5, 1e-3)
KICK = SettledKick(
    stable=True, speed_m_s=1e-3, angular_speed_rad_s=1e-2, seconds=0.5, steps=12, growing=False,
    speed_left=SettledKickRow(0.0, 0.5), distance_m=SettledKickRow(1e-6, 1e-4, 2e-5),
    angle_rad=SettledKickRow(0.0, 1.0),
)  # fmt: skip
PUSHES = (
    SettledPush((1.0, 0.0, 0.0), 0.5, 0.52, 7, float("inf"), None),
    SettledPush((0.0, 1.0, 0.0), 1.26, None, 6, None, None),
)
STABILITY = SettledStability(
    grade=0.5,
    bodies={"object": SettledBodyStability(0.5, PUSHES)},
    trials=13,
    steps=400,
    bounds=SettledPushBounds(0.05, 0.087, 0.02),
)
CONTACT = SettledContact("object", "bed", 1e-3, 9.81, 0.1, 5e-5, float("inf"), 12, 3)


def signals(row: SettledRow = ROW) -> SettledSignals:
    """Every signal with the same row."""
    return SettledSignals(row, row, row, row, row, row, row)


def implicit_certificate() -> SettledCertificate:
    """As tl writes it, with everything that can be asked for."""
    return SettledCertificate(
        arch="cpu", signals=signals(), kick=KICK, free_weight_n=9.81, length_m=0.2, newton_residual=1e-4,
        friction_cone_margin=0.9, inverted_particles=0, unlocated_points=0, material_damping_s=0.01,
        rolling_resistance=(SettledRolling("object", "bed", 1e-4, 1e-3),), stability=STABILITY,
        placement=PlacementChecks(SettledRow.at_least(1.0, 0.5), tilt_rad=ROW),
    )  # fmt: skip


def explicit_certificate() -> SettledCertificate:
    """As mls writes it."""
    return SettledCertificate(
        arch="cpu", method="mls", signals=signals(), kick=SkippedCheck(), free_weight_n=9.81, length_m=0.2,
        friction_cone_margin=0.9, inverted_particles=0, cell_m=0.01, substeps=4000, interval_s=8e-3,
    )  # fmt: skip


def history(steps: int) -> SettledHistory:
    """Signals that die out over `steps` steps."""
    series, counts = np.linspace(1.0, 0.0, steps), np.arange(steps)
    return SettledHistory(series, series, series, series, series, series, counts, counts)
