"""What the solver hands back is stored in the pipeline's own types, without a change."""

from dataclasses import replace

import numpy as np
import pytest

from dcap.scene.json_tree import to_json
from dcap.scene.types.settled import SettledVerdict
from solver.certificate import (
    BodyStability,
    Certificate,
    CertificateRow,
    ContactRow,
    KickCheck,
    KickRow,
    NotDone,
    PushBounds,
    PushRow,
    RollingRow,
    SignalRows,
    StabilityGrade,
)
from solver.rest import History
from solver.result import Verdict
from tasks.drop.settled import certificate_of, contact_of, history_of

ROWS = [CertificateRow.at_most(1e-6 * k, 1e-3) for k in range(7)]
KICK = KickCheck(
    stable=True, speed_m_s=1e-3, angular_speed_rad_s=1e-2, seconds=0.5, steps=9, growing=False,
    speed_left=KickRow(0.1, 0.5), distance_m=KickRow(1e-6, 1e-4, 2e-5), angle_rad=KickRow(1e-3, 1e-2),
)  # fmt: skip
STABILITY = StabilityGrade(
    grade=0.3,
    bodies={"object": BodyStability(0.3, (PushRow((1.0, 0.0, 0.0), 0.3, 0.32, 6, 0.1, None),))},
    trials=6,
    steps=200,
    bounds=PushBounds(0.05, 0.09, 0.02),
)
IMPLICIT = Certificate(
    arch="cpu", signals=SignalRows(*ROWS), kick=KICK, free_weight_n=9.81, length_m=0.1, newton_residual=1e-4,
    friction_cone_margin=0.8, inverted_particles=1, unlocated_points=2, material_damping_s=0.02,
    rolling_resistance=(RollingRow("object", "bed", 1e-3, 2e-3),), stability=STABILITY,
)  # fmt: skip
EXPLICIT = Certificate(
    arch="cpu", method="mls", signals=SignalRows(*ROWS), kick=NotDone(), free_weight_n=9.81, length_m=0.1,
    friction_cone_margin=0.8, inverted_particles=0, cell_m=0.01, substeps=4000, interval_s=8e-3,
)  # fmt: skip


@pytest.mark.parametrize(
    "certificate",
    [
        IMPLICIT,
        EXPLICIT,
        replace(IMPLICIT, stability=NotDone(reason="nothing rests")),
        replace(IMPLICIT, stability=None),
    ],
)
def test_nothing_of_a_certificate_is_lost_or_renamed(certificate: Certificate) -> None:
    """Written for people, the stored one is the solver's."""
    assert to_json(certificate_of(certificate)) == to_json(certificate)


@pytest.mark.parametrize("sliding_points", [3, None])
def test_nothing_of_a_contact_is_lost_or_renamed(sliding_points: int | None) -> None:
    """Nor does what one method does not count appear."""
    row = ContactRow("bed", "object", 1e-3, 9.8, 0.2, 4e-5, 1e-6, 12, sliding_points)
    assert to_json(contact_of(row)) == to_json(row)


def test_nothing_of_a_history_is_lost_or_renamed() -> None:
    """Each column with its own numbers."""
    a, b, c, d, e, f = (np.arange(3.0) + k for k in range(6))
    history = History(a, b, c, d, e, f, newton=np.arange(3), linear=np.arange(3) + 1)
    assert to_json(history_of(history)) == to_json(history)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_every_verdict_has_its_twin(verdict: Verdict) -> None:
    """Under the same code."""
    assert SettledVerdict(verdict.value).value == verdict.value
