"""The offline choice of a material: the usual one of the part, unless the sentence names another ("a mug of steel").

In: parts with their names, the things they belong to, and the prompt. Out: the id of a library row for each part, and
the reason; and the rows that a model chooses from.
"""

from collections.abc import Iterator, Sequence

from dcap.knowledge.lexicon import in_line, thing_of, vocabulary
from dcap.knowledge.material_table import FAMILIES, families
from dcap.knowledge.usual_materials import material_of, materials_in, without_id
from dcap.language.offline.words import Token, tokens_of
from dcap.language.protocol.replies import MaterialChoice
from dcap.language.protocol.requests import MaterialQuestion, MaterialsRequest
from dcap.scene.types.materials import Material

ADJECTIVAL = frozenset({"quality", "colour", "unknown", "thing", "part", "side", "number"})
"""Kinds of words that may stand between an article and its noun."""
OF = frozenset({"of", "from", "out of"})
OBJECT = "object"
ALIKE = 3
"""Number of rows of a likely family that are offered for each row of another family [-]."""


def said_of_thing(prompt: str, whole: str, *, last: bool) -> list[str]:
    """Words before and after the prompt's word for a thing; around the last occurrence if there are two and `last`."""
    tokens = tokens_of(prompt)
    there = [i for i, t in enumerate(tokens) if any(in_line(v, whole) for v in t.values("thing"))]
    # an adjective may be a thing as well, "glass table": the noun is the one not followed by another noun
    nouns = [i for i in there if not (i + 1 < len(tokens) and tokens[i + 1].has("thing", "part"))]
    return around(tokens, nouns[-1 if last else 0], whole) if nouns else []


def said_of_part(prompt: str, part: str) -> list[str]:
    """Words before the prompt's word for a part."""
    tokens = tokens_of(prompt)
    return next((around(tokens, i, part) for i, t in enumerate(tokens) if part in parts_begun_by(t)), [])


def material_words_about(prompt: str, *wholes: str) -> set[str]:
    """Words of the prompt that name materials of these things."""
    found: set[str] = set()
    for index, whole in enumerate(wholes):
        said = said_of_thing(prompt, whole, last=index > 0) if whole else []
        found.update(word for named in materials_in(said, head=False) for word in named.phrase.split())
    return found


def parts_begun_by(token: Token) -> set[str]:
    """Parts that a phrase means, or with which it begins: "top of"."""
    first = vocabulary().get((token.text.split()[0],), frozenset()) if token.text.split() else frozenset()
    return {*token.values("part"), *(meaning.value for meaning in first if meaning.kind == "part")}


def around(tokens: Sequence[Token], index: int, name: str) -> list[str]:
    """Adjectives of a noun, followed by the noun; "made of X" counts as an adjective."""
    first = index
    while first > 0 and any(meaning.kind in ADJECTIVAL for meaning in tokens[first - 1].meanings):
        first -= 1
    before = [word for token in tokens[first : index + 1] for word in token.text.split()]
    return [*after(tokens, index), *without_id(before, name)]


def after(tokens: Sequence[Token], index: int) -> list[str]:
    """Words of "made of X" after a noun."""
    words = [word for token in tokens[index + 1 :] for word in token.text.split()]
    if words[:1] == ["made"]:
        words = words[1:]
    return words[1:4] if words[:1] and words[0] in OF else []


def chosen_materials(request: MaterialsRequest) -> Iterator[MaterialChoice]:
    """The material of each part and the reason."""
    known = {material.id for material in request.library}
    for question in request.questions:
        material, reason = material_of(question.label, question.part.name, known, said_of(question, request))
        yield MaterialChoice(body=question.body, part_index=question.part.index, material=material, reason=reason)


def shortlist(request: MaterialsRequest, most: int) -> tuple[Material, ...]:
    """Rows of the request's library for its parts, in the order of the library: for each part the row named by its name
    and the words, then rows of all families in turn, three of those families for each row of another, up to `most`."""
    known = {row.id: row for row in request.library}
    chosen = dict.fromkeys(one.material for one in chosen_materials(request))
    near = dict.fromkeys(families()[one] for one in chosen)
    by_family = {kind: [row for row in known if families()[row] == kind] for kind in (*near, *FAMILIES)}
    for turn in range(len(known)):
        for kind, alike in by_family.items():
            count = ALIKE if kind in near else 1
            for row in alike[turn * count : (turn + 1) * count]:
                if len(chosen) < most:
                    chosen[row] = None
    return tuple(row for name, row in known.items() if name in chosen)


def said_of(question: MaterialQuestion, request: MaterialsRequest) -> list[str]:
    """Words of the prompt about the whole or the part; empty for things that are neither object nor base."""
    is_object = question.body == OBJECT
    if not is_object and question.body != request.base_id:
        return []
    thing = thing_of(question.label)
    whole = said_of_thing(request.prompt, thing.id, last=not is_object) if thing else []
    return whole if is_object else [*said_of_part(request.prompt, question.part.name), *whole]
