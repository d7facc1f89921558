"""The target of a sentence whose support a person has pointed at: the sentence says where on it, no longer on what."""

from collections.abc import Sequence
from dataclasses import replace

from dcap.language.offline.ground import candidates, named, part_of
from dcap.language.offline.grounded import Target
from dcap.language.offline.placing import names_support, placing_of, whole
from dcap.language.offline.reading import Place, Reading
from dcap.language.offline.target import target_of
from dcap.language.protocol.requests import InstanceView, IntentRequest
from dcap.scene.errors import LanguageError
from dcap.scene.types.caution import Cause, Caution


def given_target(reading: Reading, request: IntentRequest) -> Target:
    """Part, regions and references on the given base; a sentence that names no support will do."""
    base = next(one for one in request.instances if one.id == request.given_base)
    try:
        main = placing_of(reading).place
    except LanguageError:
        return Target(base=base, not_understood=list(reading.not_understood))
    target = target_of(reading, replace(request, instances=with_one_support(base, main, request.instances)))
    if target.base is None:
        told = f"the scene has no {target.missing}; what was pointed at decides"
        target.notes.append(Caution(Cause.NOT_MET, told))
        target.missing, target.part, target.regions, target.references = "", "", [], []
    elif target.base.id != base.id:
        target.part, target.which = "", ""
    own = {part.name for part in base.parts}
    target.references = [one for one in target.references if one != base.id and part_of_it(one, own)]
    known = [one for one in target.constraints if one.reference != base.id and part_of_it(one.reference, own)]
    target.constraints, target.candidates = known, ()
    target.lean_on = target.lean_on if target.lean_on != base.id and part_of_it(target.lean_on, own) else ""
    target.base = base
    target.part = target.part if target.part in own else ""
    return target


def part_of_it(reference: str, own: set[str]) -> bool:
    """Whether a reference is an instance's or a part that the base has."""
    kind, _, name = reference.partition(":")
    return kind != "part" or name.partition("/")[0] in own


def with_one_support(base: InstanceView, main: Place, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """The instances of which the sentence's support can only be the given one, whatever that is called."""
    if not names_support(main):
        return tuple(instances)
    noun = whole(main)
    others = {one.id for one in candidates(noun, instances)} - {base.id}
    known = named(noun, [base]) or part_of(noun, base) or not noun.thing
    called = base if known else replace(base, label=noun.name or noun.thing, guesses=())
    return (*(one for one in instances if one.id not in others and one.id != base.id), called)
