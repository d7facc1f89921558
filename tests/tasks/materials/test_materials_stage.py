"""One row of the library for each part, with its reason."""

from collections import Counter
from dataclasses import replace

import pytest
from box_rooms import CUBE, ROOM, ball, mug, thing
from questions_at_hand import materials_request
from stage_chain import Stages

from dcap.knowledge.material_table import families
from dcap.language.offline.client import OfflineClient
from dcap.language.offline.material_choice import chosen_materials, shortlist
from dcap.scene.types.materials import BodyModel, PartMaterials
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.materials.stage import MaterialsConfig, materials

OFFLINE = Stages()


def test_one_row_per_part_and_the_gigapascal_rule(stages):
    """Object first, then the base; wood is rigid, the mattress is soft, each with a reason."""
    chosen = stages.made_of("put the mug on the bed", thing("mug", mug()))
    assert chosen.rows[0].body == "object"
    assert chosen.of("bed", 1).model is BodyModel.MPM
    assert chosen.of("bed", 0).model is BodyModel.RIGID
    assert all(row.reason for row in chosen.rows)
    assert all((row.material.youngs_modulus > 1e9) == (row.model is BodyModel.RIGID) for row in chosen.rows)
    assert "weighs" in chosen.rows[0].reason


def test_paper_limits_are_an_option():
    """Off by default; on, soft foam is clamped to 5e4 Pa and the reason says so."""
    item = thing("ball", ball())
    meant, _, found = OFFLINE.placed("put the ball on the bed", item)
    plain = materials(SegmentedScene(ROOM), SegmentedObject(item), meant, found, "", MaterialsConfig(), OfflineClient())
    clamped = materials(
        SegmentedScene(ROOM),
        SegmentedObject(item),
        meant,
        found,
        "",
        MaterialsConfig(paper_limits=True),
        OfflineClient(),
    )
    assert not isinstance(plain, Infeasible)
    assert not isinstance(clamped, Infeasible)
    assert plain.of("bed", 1).material.youngs_modulus < 5e4
    assert clamped.of("bed", 1).material.youngs_modulus == 5e4
    assert "limits" in clamped.of("bed", 1).reason
    assert (plain.limits, clamped.limits) == ("none", "paper_limits")
    assert "paper's limits" in clamped.notes[0]
    assert plain.notes == ()


def test_materials_hear_the_whole_prompt(stages):
    """What the sentence calls the object and its support made of counts, each for its own."""
    chosen = stages.made_of("put the steel cube on the glass table", CUBE)
    top = next(row for row in chosen.rows if row.body == "table" and row.part in ("top", "body"))
    assert (chosen.rows[0].material.id, top.material.id) == ("steel", "glass")
    assert "'glass'" in top.reason
    assert chosen.rows[0].material.source.startswith("density")


@pytest.mark.parametrize(("share", "model"), [(1.4, BodyModel.RIGID), (0.7, BodyModel.MPM)])
def test_what_nobody_would_see_give_is_rigid_if_asked(share, model):
    """On either side of the dent that Hertz predicts for the ball in the mattress; the curvature of a ball of triangles
    is known to a factor of 2.7, so the dent, which goes with its cube root, to 1.4."""
    item = thing("ball", ball(0.1))
    meant, _, found = OFFLINE.placed("put the ball on the mattress", item)
    plain = materials(SegmentedScene(ROOM), SegmentedObject(item), meant, found, "", MaterialsConfig(), OfflineClient())
    assert isinstance(plain, PartMaterials)
    foam = plain.of("bed", 1).material
    effective = foam.youngs_modulus / (1.0 - foam.poisson_ratio**2)
    dent = (9.0 * (meant.mass * 9.81) ** 2 / (16.0 * 0.1 * effective**2)) ** (1.0 / 3.0)
    config = MaterialsConfig(load_aware=True, invisible=share * dent)
    aware = materials(SegmentedScene(ROOM), SegmentedObject(item), meant, found, "", config, OfflineClient())
    assert isinstance(aware, PartMaterials)
    row = aware.of("bed", 1)
    assert row.model is model
    assert ("load-aware" in row.reason) == (model is BodyModel.RIGID)
    assert any("mattress" in note for note in aware.notes) == (model is BodyModel.RIGID)
    assert (plain.of("bed", 1).model, plain.notes) == (BodyModel.MPM, ())


def test_what_is_named_and_what_is_alike_is_offered() -> None:
    """The usual row of each part, the row that the prompt names, more of that family, and some of every other one: what
    the picture shows may be made of anything. The choice among them is that among all."""
    whole = replace(materials_request(), prompt="put the steel mug on the desk")
    few = replace(whole, library=shortlist(whole, 20))
    assert len(few.library) == 20
    (best,) = chosen_materials(whole)
    assert best.material == "steel"
    assert list(chosen_materials(few)) == [best]
    kinds = Counter(families()[row.id] for row in few.library)
    assert set(kinds) == set(families().values())
    assert kinds["metal"] >= 4


def test_many_parts_keep_their_rows() -> None:
    """Where more parts are asked about than rows are offered, each has its own."""
    request = materials_request()
    parts = [replace(request.questions[0].part, index=k, name=name)
             for k, name in enumerate(("mattress", "pillow", "blanket", "leg", "frame", "glass pane"))]  # fmt: skip
    whole = replace(request, questions=tuple(replace(request.questions[0], label="bed", part=one) for one in parts))
    wanted = {one.material for one in chosen_materials(whole)}
    assert len(wanted) > 2
    assert {row.id for row in shortlist(whole, 2)} == wanted
