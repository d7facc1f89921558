"""Stage 3, intent: one question about the sentence; its answer fixes base, size, mass, orientation and region.

In: the segmented scene and object, the prompt, and the mass if the user states it. Out: `Intent`, or `target_not_found`
with a list of the scene's things; an ambiguous choice becomes a question to the user (see `request.py`). One isotropic
factor gives the mesh the usual size of its kind (see `rescale.py`); a mesh of a plausible size is not changed. The mass
prior scales with the size: by volume, for hollow things by surface, for sheets by area.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveFloat

from dcap.language.connect import Client
from dcap.language.offline.ground import NAMELESS
from dcap.language.offline.likelihood import LEAST
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.replies import Candidate, IntentReply, region_constraints
from dcap.language.protocol.requests import IntentRequest
from dcap.scene.errors import InputError
from dcap.scene.types.choices import Intent, OrientationRequest, RegionRequest, SupportCandidate
from dcap.scene.types.outcome import Cause, Caution, Infeasible, NotInScene, Reason
from dcap.scene.types.segmentation import Pointed, SegmentedObject, SegmentedScene
from tasks.cache import stage
from tasks.intent.request import SURE_BY_SHAPE, doubted, intent_request, settle_choice
from tasks.intent.rescale import rescale
from tasks.requests.views import instance_of

LONGEST_PROMPT = 1000
"""Maximum length of a prompt [characters]; a longer text is not an instruction to place one object."""
SHEET = 0.05
"""Ratio of thickness to width below which a thing is a sheet, whose mesh may have any thickness."""


POINT_OR_NAME = "point at a place with --at X,Y,Z, or name things with dcap dataset label and --labels"


class IntentConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client, and limits of rescaling."""

    language: LanguageConfig = LanguageConfig()
    ambiguous: Literal["ask", "best"] = "ask"
    """If another thing has at least half of the best one's likelihood: ask, or take the best with a note."""
    smallest_scale: PositiveFloat = 1e-3
    """Smallest isotropic scale factor [-]."""
    largest_scale: PositiveFloat = 1e3
    """Largest isotropic scale factor [-]."""
    mass_factor: PositiveFloat = 5.0
    """Largest change of the usual mass because of an unusual size [-]."""


def intent(
    scene: SegmentedScene,
    item: SegmentedObject,
    prompt: str,
    mass: float | None,
    config: IntentConfig,
    client: Client,
    pointed: Pointed | None = None,
) -> Intent | Infeasible:
    """Ask once, then turn the priors into a scale and a mass; `pointed` determines the base, and perhaps the place."""
    if len(prompt) > LONGEST_PROMPT:
        raise InputError(f"the prompt has {len(prompt)} characters > {LONGEST_PROMPT}")
    if mass is not None and not (np.isfinite(mass) and mass > 0):
        raise InputError(f"--mass {mass} is not a positive number of kilograms")
    request = intent_request(scene, item, prompt, "" if pointed is None else pointed.base_id)
    reply = client.ask(INTENT, request)
    if not reply.base_id:
        return not_found(reply, request)
    unsure = doubted(reply, request) if config.ambiguous == "ask" else None
    if unsure is not None:
        return not_sure(unsure, reply, request)
    open_choice = settle_choice(reply, request, ask=config.ambiguous == "ask")
    extents = np.array(request.item.size)
    shapes, limits = np.array([reply.size, *reply.alternative_sizes]), (config.smallest_scale, config.largest_scale)
    fit = rescale(shapes, extents, reply.spread, limits, item.unit_source)
    weight, mass_note = mass_of(reply, fit.shape, extents * fit.scale, mass, config)
    region, where_notes = place_of(reply, pointed)
    label = {one.id: one.label for one in request.instances}
    likely = [SupportCandidate(one.id, label[one.id], one.likelihood) for one in reply.candidates]
    likely.sort(key=lambda one: (one.id != reply.base_id, -one.score, one.id))  # the chosen one first
    return Intent(
        base_id=reply.base_id,
        base_label=instance_of(scene, reply.base_id).label,
        object_name=reply.object_name,
        size=fit.shape,
        mass=weight,
        hollow=reply.hollow,
        scale=fit.scale,
        orientation=OrientationRequest(
            reply.pose, reply.facing, reply.orientation_words, reply.turn_deg, reply.lean_on
        ),
        region=region,
        not_understood=reply.not_understood,
        notes=(*where_notes, *reply.notes, *open_choice, fit.note, mass_note),
        candidates=tuple(likely) or (SupportCandidate(reply.base_id, label[reply.base_id], 1.0),),
        mass_given=mass is not None,
        at=None if pointed is None or not len(pointed.point) else pointed.point,
    )


intent_task = stage(intent)


def not_found(reply: IntentReply, request: IntentRequest) -> Infeasible:
    """The refusal of a thing that the scene lacks, with a list of its things."""
    present = sorted({i.label for i in request.instances if not i.structure})
    structure = sorted({i.label for i in request.instances if i.structure})
    there = ", ".join([*present, *structure]) or "nothing with a name"
    meant = f" (did you mean the {reply.did_you_mean}?)" if reply.did_you_mean else ""
    missing = reply.missing.removeprefix("the ").removeprefix("a ")
    shapes = named_by_shape(reply, request)
    hint = "" if present else f"; {POINT_OR_NAME}"
    none = f"nothing here is known as {missing} by its shape" if shapes else f"the scene has no {missing}"
    evidence = NotInScene(asked=reply.missing, present=(*present, *structure), object=reply.object_name)
    return Infeasible(Reason.TARGET_NOT_FOUND, f"{none}{meant}; it has: {there}{shapes}{hint}", evidence)


def not_sure(likeliest: Candidate, reply: IntentReply, request: IntentRequest) -> Infeasible:
    """The refusal of an uncertain guess, which asks the user: a wrong guess would only be noticed in the result."""
    label = {one.id: one.label for one in request.instances}[likeliest.id]
    says = likeliest.id if label == NAMELESS else f"the {label} with id {likeliest.id}"
    present = tuple(sorted({one.label for one in request.instances if not one.structure}))
    return Infeasible(
        Reason.TARGET_NOT_FOUND,
        f"which thing does {request.prompt!r} mean? The scene has no labels: by its shape {likeliest.id} ({label}) "
        f"is meant with likelihood {likeliest.likelihood:.2f}, below the limit of {SURE_BY_SHAPE:g}. "
        f"candidates.png shows everything with its id: say which in the sentence ({says!r}), point with "
        "--at X,Y,Z, name things with dcap dataset label and --labels, or take the likeliest with --ambiguous best",
        NotInScene(asked=request.prompt, present=present, object=reply.object_name),
    )


def named_by_shape(reply: IntentReply, request: IntentRequest) -> str:
    """For a scene without labels: the things nearest to the missing one, and a way to name it; else empty."""
    if not any(one.guesses for one in request.instances):
        return ""
    nearest = ", ".join(f"{one.id} ({one.likelihood:.2f})" for one in reply.candidates)
    likely = f"likeliest: {nearest}, less than {LEAST:g} is not taken" if nearest else "none is likely to be it"
    return f". Its things are named by shape alone ({likely}); candidates.png shows them: {POINT_OR_NAME}"


def mass_of(
    reply: IntentReply,
    shape: NDArray[np.float64],
    size: NDArray[np.float64],
    mass: float | None,
    config: IntentConfig,
) -> tuple[float, str]:
    """Mass [kg] of the scaled extents, given the usual extents `shape` [m], both largest first, and the reason."""
    if mass is not None:
        return float(mass), f"mass {mass:.3g} kg was given"
    ratio = size / shape
    if shape[2] < SHEET * shape[1]:
        factor, kind = float(ratio[0] * ratio[1]), "a sheet, so with the area"
    elif reply.hollow:
        factor, kind = float(np.prod(ratio)) ** (2.0 / 3.0), "hollow, so with the surface"
    else:
        factor, kind = float(np.prod(ratio)), "with the volume"
    used = float(np.clip(factor, 1 / config.mass_factor, config.mass_factor))
    clamped = "" if used == factor else f", clamped from {factor:.3g} (mass_factor {config.mass_factor:g})"
    weight = reply.mass * used
    note = f"mass {weight:.3g} kg: {reply.mass:.3g} kg at the usual size, scaled {kind} by {used:.3g}{clamped}"
    return weight, Caution(Cause.ASSUMED, f"{note}; set it with --mass") if clamped else note


def place_of(reply: IntentReply, pointed: Pointed | None) -> tuple[RegionRequest, tuple[str, ...]]:
    """The region of the sentence and notes; a point given separately overrides it, with a note if the sentence also
    names a region."""
    if pointed is None or not len(pointed.point):
        limits = region_constraints(reply.constraints)
        said = RegionRequest(reply.part, reply.regions, reply.references, reply.region_words, reply.which, limits)
        return said, () if pointed is None else pointed.notes
    words = reply.region_words or reply.part
    told = reply.regions or reply.part or reply.constraints or reply.lean_on
    lost = (Caution(Cause.NOT_MET, f"--at determines the place: {words!r} is ignored"),) if told else ()
    return RegionRequest("", (), (), ""), (*pointed.notes, *lost)
