"""The methods that a benchmark compares: names as people type them, as tables show them, and samples of each."""

from collections.abc import Sequence
from dataclasses import replace

from dcap.scene.errors import InputError
from dcap.scene.text import not_one_of
from dcap.scene.types.sample import Sample

DCAP, LAYOUTGPT = "dcap", "layoutgpt"
BASELINES = {"fireplace": "FirePlace*", "layoutgpt": "LayoutGPT", "holodeck": "Holodeck"}
"""Other authors' methods, as rebuilt by us; they propose a pose and simulate nothing."""
ABLATIONS = {
    "rigid_drop": "DCAP, everything rigid",
    "no_drop": "DCAP, pose before the drop",
    "no_size_prior": "DCAP, size as in the file",
    "no_rotation": "DCAP, pose as in the file",
    "no_subpart": "DCAP, middle of the support",
    "face_up": "DCAP, level patches only",
    "views_12": "DCAP, twelve pictures",
    "pose_strip": "DCAP, picture of all poses",
    "blended_materials": "DCAP, blended materials",
    "uniform_fill": "DCAP, uniform cells",
    "paper": "DCAP with the paper's solver",
}
"""Ablations: DCAP without one of its ideas each."""
METHODS = {DCAP: "DCAP", **BASELINES, **ABLATIONS}
ALL = (DCAP, *BASELINES, "rigid_drop")
"""Methods of `--methods all`."""
OFFLINE = " (offline rules)"
"""Suffix of a baseline's name that ran without a model."""


def methods_of(text: str) -> tuple[str, ...]:
    """Methods of a comma-separated list, in the order of METHODS; InputError for an unknown name."""
    asked = {one.strip() for one in text.split(",") if one.strip()}
    for name in sorted(asked - {"all"}):
        if name not in METHODS:
            raise InputError(f"--methods {name!r} {not_one_of(name, (*METHODS, 'all'))}")
    if not asked:
        raise InputError(f"--methods is empty; there are {', '.join(METHODS)} and all")
    asked |= set(ALL) if "all" in asked else set()
    return tuple(name for name in METHODS if name in asked)


def method_named(name: str) -> str:
    """The name of one method; InputError for any other."""
    if name not in METHODS:
        raise InputError(f"--method {name!r} {not_one_of(name, METHODS)}")
    return name


def shown_name(method: str, *, offline: bool) -> str:
    """A method's name in tables; unknown names are unchanged."""
    return METHODS.get(method, method) + (OFFLINE if offline and method in BASELINES else "")


def baselines_among(methods: Sequence[str]) -> tuple[str, ...]:
    """Methods that tables test against: the baselines among them, or all methods if there are only variants of ours."""
    return tuple(name for name in methods if name in BASELINES) or tuple(methods)


def by_method(sample: Sample, method: str) -> Sample:
    """The sample for another method; its id becomes `METHOD/ID`."""
    return sample if method == DCAP else replace(sample, id=joined_id(method, sample.id), method=method)


def with_examples(samples: Sequence[Sample], every: Sequence[Sample]) -> list[Sample]:
    """The samples; those of LayoutGPT get as examples all scenes of the whole data set, `every`, that are read with the
    same options. They do not depend on which samples are run."""
    found = []
    for sample in samples:
        others = dict.fromkeys(
            one.scene for one in every
            if one.scene != sample.scene and one.scene_options == sample.scene_options
            and not one.labels and one.known_height is None
        )  # fmt: skip
        found.append(replace(sample, examples=tuple(others)) if sample.method == LAYOUTGPT else sample)
    return found


def joined_id(method: str, name: str) -> str:
    """The id of a method's sample."""
    return name if method == DCAP else f"{method}/{name}"


def split_id(sample_id: str) -> tuple[str, str]:
    """Split an id into the method and the sample's own id."""
    method, slash, name = sample_id.partition("/")
    return (method, name) if slash and method in METHODS else (DCAP, sample_id)
