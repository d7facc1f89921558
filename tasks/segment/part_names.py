"""Names of parts: geometry proposes, a client names.

In: a divided scene or object. Out: the same with the client's names; faces, boxes and the number of parts stay, so two
parts that get one name remain two.
"""

from dataclasses import replace
from functools import partial

from dcap.geometry.segmentation.labels import SYNONYMS
from dcap.language.connect import Client
from dcap.language.offline.lexicon import part_words
from dcap.language.protocol.questions import PARTS
from dcap.language.protocol.requests import PartsRequest, Picture, ProposedPart
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from tasks.requests.views import Sums, part_views, sums_of
from tasks.segment.part_pictures import paint, parts_picture


def with_part_names(scene: Segmentation, client: Client) -> Segmentation:
    """Ask what the parts are called: one question for every instance of two parts or more, however many there are.

    Not asked are structure and what an annotation names.
    """
    asked = [i for i, one in enumerate(scene.instances) if is_asked(one)]
    if not asked:
        return scene
    sums, instances = sums_of(scene), list(scene.instances)
    replies = client.ask_all(PARTS, [parts_request(scene, i, sums) for i in asked])
    for i, reply in zip(asked, replies, strict=True):
        chosen = {one.index: one for one in reply.names}
        parts = (Part(chosen[k].name, p.box, chosen[k].confidence) for k, p in enumerate(instances[i].parts))
        instances[i] = replace(instances[i], parts=tuple(parts))
    return replace(scene, instances=tuple(instances))


def is_asked(instance: Instance) -> bool:
    """Whether there is something to tell apart that the source does not name for certain."""
    return not instance.structure and len(instance.parts) > 1 and any(p.confidence < 1.0 for p in instance.parts)


def parts_request(scene: Segmentation, index: int, sums: Sums) -> PartsRequest:
    """The question about one instance."""
    instance = scene.instances[index]
    parts = tuple(
        ProposedPart(view, part.confidence, paint(view.index))
        for view, part in zip(part_views(scene, index, sums), instance.parts, strict=True)
    )
    names = {*SYNONYMS, *part_words(), *(part.name for part in instance.parts)}
    pictures = (
        Picture("the thing alone, each part in its own colour with its index", partial(parts_picture, scene, index)),
    )
    return PartsRequest(instance.id, instance.label, parts, tuple(sorted(names)), pictures)
