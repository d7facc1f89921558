"""Which of several alike: tables in a row, a lamp on one of them."""

from dataclasses import replace

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.requests import InstanceView, PartView

Vector = tuple[float, float, float]


def thing(
    name: str, label: str, center: Vector, size: Vector, front: Vector | None = None, *parts: str
) -> InstanceView:
    """An axis-aligned block, each part as large as the whole."""
    low = (center[0] - size[0] / 2, center[1] - size[1] / 2, center[2] - size[2] / 2)
    high = (center[0] + size[0] / 2, center[1] + size[1] / 2, center[2] + size[2] / 2)
    views = tuple(PartView(k, part, center, size) for k, part in enumerate(parts or ("body",)))
    return InstanceView(name, label, center, size, low, high, front, label == "floor", (0.5, 0.5, 0.5), views)


TABLES = tuple(
    thing(f"table_{k}", "side table", (x, 2.3, 0.25), (0.5, 0.4, 0.5), (0.0, -1.0, 0.0))
    for k, x in enumerate((-1.5, -0.5, 0.5, 1.5))
)
ON_THEM = (
    thing("lamp_0", "table lamp", (0.6, 2.35, 0.7), (0.25, 0.25, 0.4)),
    thing("books_0", "book", (1.4, 2.35, 0.56), (0.2, 0.15, 0.1)),
    thing("floor_0", "floor", (0.0, 0.0, -0.05), (7.0, 6.0, 0.1)),
    thing("stand_0", "basin cabinet", (3.0, 2.3, 0.4), (1.0, 0.5, 0.8), None, "top", "basin"),
    thing("window_0", "window", (-3.4, 2.3, 1.5), (0.1, 1.2, 1.2)),
)

# prompt | base and part | regions | references
SENTENCES = """
put the mug on the side table next to the lamp | table_2 | next_to | lamp_0
put the mug on the side table left of the lamp | table_2 | left,next_to | lamp_0
put the mug on the side table near the books | table_3 | near | books_0
put the mug on the left side table next to the lamp | table_0 | next_to | lamp_0
put the mug on the side table near the window | table_0 | |
put the mug under the desk lamp | table_2 | under | lamp_0
put the mug next to the lamp | table_2 | next_to | lamp_0
put the mug on the third side table from the left | table_2 | |
put the mug on the second side table from the right | table_2 | |
put the mug on the first side table from the right | table_3 | |
put the mug on the second side table | table_1 | |
put the mug on the rightmost side table | table_3 | |
put the soap on the washstand | stand_0 | |
put the soap in the sink | stand_0 basin | |
put the soap next to the sink on the washstand | stand_0 | next_to | part:basin
put the soap on the edge of the sink | stand_0 basin | edge |
""".strip().splitlines()


def test_the_meant_one_of_several_is_taken(ask):
    """What stands on one of them tells it as well as a side, a number or a thing apart."""
    missed = []
    for line in SENTENCES:
        prompt, *meant = (cell.strip() for cell in line.split("|"))
        reply = OfflineClient().ask(INTENT, replace(ask(prompt), instances=(*TABLES, *ON_THEM)))
        found = [f"{reply.base_id} {reply.part}".strip(), ",".join(reply.regions), ",".join(reply.references)]
        if found != meant or reply.not_understood:
            missed.append((prompt, found, reply.not_understood))
    assert missed == []
