"""What `dcap.place` returns without a rest state: typed where keys are fixed, named where they are not."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rest_records import CHECKS, CONTACT, implicit_certificate

from dcap.scene.errors import InputError
from dcap.scene.types.outcome import Infeasible, NotInScene, Reason
from dcap.scene.types.settled import LastState
from flows.placement_json import Values, certificate_of
from flows.results import Placement

PLACE, TURN = np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.0, 0.0, 0.0])
LAST = LastState(implicit_certificate(), (CONTACT,), PLACE, TURN, 12, 0.5, ("moving",), CHECKS)


def written(infeasible: Infeasible) -> dict[str, Any]:
    """placement.json of a placement that ended in a reason, as far as this is about it."""
    names = (one.name for one in fields(Values) if not one.name.endswith("surface"))
    nothing: dict[str, Any] = dict.fromkeys(names) | {"infeasible": infeasible}
    keys = {one.name for one in fields(Placement)} - {"folder", "tree", "checks", "evidence"}
    return dict.fromkeys(keys) | {
        "schema": 1, "verdict": "infeasible", "reason": infeasible.reason.value, "prompt": "put it there",
        "contacts": [], "candidates": [],
        "materials": [], "geometry": [], "soft_bodies": [], "warnings": [], "notes": [], "timings": {}, "artifacts": {},
        "certificate": certificate_of(Values(**nothing)),
    }  # fmt: skip


def test_what_a_stage_before_the_drop_found_is_evidence(tmp_path: Path) -> None:
    """Without a drop there is no certificate, but what the stage found has names."""
    found = Infeasible(Reason.TARGET_NOT_FOUND, "no piano", NotInScene("the piano", ("bed", "sofa"), "ball"))
    placement = Placement.of(written(found), tmp_path)
    assert placement.certificate is None
    assert placement.checks is None
    assert (placement.evidence.asked, placement.evidence.present) == ("the piano", ("bed", "sofa"))


def test_the_last_state_of_a_drop_is_evidence(tmp_path: Path) -> None:
    """Certificate and checks are those of a drop; where the object was at its end has names."""
    tree = written(Infeasible(Reason.LEFT_TARGET, "it left", LAST))
    placement = Placement.of(tree, tmp_path)
    assert placement.certificate is not None
    assert placement.certificate.signals == LAST.certificate.signals
    assert placement.certificate.kick == LAST.certificate.kick
    assert placement.checks == LAST.checks
    assert placement.evidence.position == (1.0, 2.0, 3.0)
    assert set(placement.evidence) == {"position", "quaternion", "simulated_s", "steps"}
    assert "bonds" not in tree["certificate"]
    assert list(tree["certificate"]["placement"]) == ["carried_share", "indentation_m", "tilt_rad"]


def test_a_file_with_other_keys_is_refused_in_one_line(tmp_path: Path) -> None:
    """It names the file and the key, also of a number that JSON does not have and that is null there."""
    tree = written(Infeasible(Reason.LEFT_TARGET, "it left", LAST))
    tree["certificate"]["signals"]["linear_speed"]["value"] = None
    with pytest.raises(InputError, match=r"placement.json: certificate.signals.linear_speed.value: .*None"):
        Placement.of(tree, tmp_path)


def test_a_file_from_before_the_version_is_read(tmp_path: Path) -> None:
    tree = written(Infeasible(Reason.LEFT_TARGET, "it left", LAST))
    assert Placement.of(tree, tmp_path).schema == 1
    del tree["schema"], tree["soft_bodies"], tree["visibility"], tree["notes"]
    earlier = Placement.of(tree, tmp_path)
    assert (earlier.schema, earlier.notes) == (0, ())
