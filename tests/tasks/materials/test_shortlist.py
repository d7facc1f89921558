"""A model is offered few rows of the library: those that the parts may be made of."""

from collections import Counter
from dataclasses import replace

from questions_at_hand import materials_request

from dcap.language.material_table import families
from dcap.language.offline.material_choice import chosen_materials, shortlist


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
