"""Stage found_scale: the scale of a file of unknown unit, from the height of one thing in it.

In: the scan at a guessed scale, and the height of the main surface of a thing above the floor. Out: the length of the
file's unit. If the scene names the thing, its surface determines the scale. Otherwise every level with a large upward
surface is a candidate: each gives a scale, and the candidate at whose scale the scene contains such a thing at that
height is chosen, the most certain one of several; sizes and heights of all other things influence the certainty of a
label.
"""

from dataclasses import dataclass, replace

import numpy as np

from dcap.arrays import Array
from dcap.geometry.segmentation.faces import UPWARD, level_of, main_level
from dcap.knowledge.lexicon import is_a, label_words, thing_of
from dcap.language.connect import Client
from dcap.scene.errors import InputError
from dcap.scene.text import says_something
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import KnownHeight
from dcap.scene.types.scan import FileScale, Scan
from dcap.scene.types.segmentation import GivenLabels, Segmentation
from tasks.cache import stage
from tasks.segment.stage import SegmentConfig, segment

BINS = 120
"""Number of heights between the floor and the top that are distinguished [-]."""
LEAST_SHARE = 0.004
"""Least share of the plan for a level that can carry things [-]."""
MOST_LEVELS = 6
"""Maximum number of levels that are tried, those with the largest area [-]."""
NEAR = 0.06
"""Maximum deviation of the thing's surface from the known height at its own scale, over that height [-]."""
HEIGHT = (1.2, 9.0)
BREADTH = (1.5, 60.0)
"""Ranges of the height and of the longer side of a furnished scene [m]."""
USUAL_HEIGHT, SPREAD = 2.5, 0.25
"""Usual height of a room [m], and the deviation of its logarithm [-]: breaks ties between a table and a stool."""
SURE = 0.9
"""Confidence from which a label was not guessed [-]."""


@dataclass(frozen=True, slots=True)
class Level:
    """A height at which things may stand."""

    height: float
    """Height above the floor, at the guessed scale [m]."""
    area: float
    """Upward area at that height [m^2]."""


def found_scale(
    scan: Scan, known: KnownHeight, config: SegmentConfig, client: Client, labels: GivenLabels | None = None
) -> FileScale:
    """The length of the file's unit; raises InputError if no such thing is found at any height."""
    if scan.boxes or any(says_something(name) for name in scan.node_names) or labels is not None:
        scene = segment(scan, config, client, labels)
        sure = [height for height, confidence in heights(scene, known.thing) if confidence >= SURE and height > 0]
        if sure:
            return scale_of(scan, known, float(np.median(sure)))
    tried = levels(scan.mesh)
    found = [fit for level in tried if (fit := fitting(scan, known, level, config, client)) is not None]
    if not found:
        shares = ", ".join(f"{one.height / scan.unit_metres:.3g}" for one in tried) or "none"
        raise InputError(
            f"--height-of {known.thing}={known.height:g}: no {known.thing} is found at that height, whatever the scale "
            f"(something looks up at {shares} units above the floor); give the height of another thing, or --unit"
        )
    return scale_of(scan, known, max(found)[1])


found_scale_task = stage(found_scale)


def scale_of(scan: Scan, known: KnownHeight, height: float) -> FileScale:
    """The unit at which a height at the guessed scale equals the known height."""
    metres = scan.unit_metres * known.height / height
    units = height / scan.unit_metres
    note = (
        f"--height-of {known.thing}={known.height:g}: its surface is {units:.4g} units above the floor, "
        f"so a unit is {metres:.4g} m"
    )
    return FileScale(metres, note)


def heights(scene: Segmentation, thing: str) -> list[tuple[float, float]]:
    """Height above the floor [m] and certainty of each instance of that kind of thing."""
    ground = floor_level(scene)
    found = []
    for index, one in enumerate(scene.instances):
        guessed = max((share for label, share in one.guesses if is_such(label, thing)), default=0.0)
        sure = one.confidence if is_such(one.label, thing) else guessed
        if sure > 0.0:
            level = main_level(scene.mesh, np.flatnonzero(scene.face_instance == index))
            if not np.isnan(level):
                found.append((level - ground, sure))
    return found


def is_such(label: str, thing: str) -> bool:
    """Return whether a label is the named thing, or a kind of it."""
    if tuple(label_words(label)) == tuple(label_words(thing)):
        return True
    has, asked = thing_of(label), thing_of(thing)
    return has is not None and asked is not None and is_a(has.id, asked.id)


def floor_level(scene: Segmentation) -> float:
    """Height of the floor, or of the lowest point without a floor [m]."""
    for index, one in enumerate(scene.instances):
        if one.structure and one.label == "floor":
            level = main_level(scene.mesh, np.flatnonzero(scene.face_instance == index))
            if not np.isnan(level):
                return level
    return float(scene.mesh.bounds[0, 2])


def levels(mesh: Mesh) -> list[Level]:
    """Levels above the floor with the largest upward area, in order of area; independent of the scale."""
    normal = mesh.face_normals
    area = 0.5 * np.linalg.norm(normal, axis=1)
    up = normal[:, 2] > 2.0 * UPWARD * area
    height, area = mesh.triangles[up, :, 2].mean(axis=1), area[up]
    if not len(height):
        return []
    low, high = np.quantile(mesh.vertices[:, 2], [0.005, 0.995])
    step = max(float(high - low), 1e-9) / BINS
    ground = level_of(height[height < low + 0.35 * (high - low)], area[height < low + 0.35 * (high - low)], 2.0 * step)
    above = height - (low if np.isnan(ground) else ground)
    kept = (above > 3.0 * step) & (above < 0.8 * (high - low))
    plan = float(np.prod(np.ptp(np.quantile(mesh.vertices[:, :2], [0.005, 0.995], axis=0), axis=0)))
    return peaks(above[kept], area[kept], step, LEAST_SHARE * plan)


def peaks(height: Array, area: Array, step: float, least: float) -> list[Level]:
    """The heights with the largest area one after the other, each time after removing the area around the previous
    one."""
    found: list[Level] = []
    while len(height) and len(found) < MOST_LEVELS:
        level = level_of(height, area, 2.0 * step)
        near = np.abs(height - level) < 2.0 * step
        if float(area[near].sum()) < least:
            break
        found.append(Level(level, float(area[near].sum())))
        height, area = height[~near], area[~near]
    return found


def fitting(
    scan: Scan, known: KnownHeight, level: Level, config: SegmentConfig, client: Client
) -> tuple[float, float] | None:  # fmt: skip
    """Likelihood that a level is the thing's [-], and the height of its surface at the guessed scale [m]; None if it is
    not.

    The surface is measured again at the right scale, because levels are only as precise as bins.
    """
    factor = known.height / level.height
    size = factor * np.ptp(np.quantile(scan.mesh.vertices, [0.005, 0.995], axis=0), axis=0)
    if not HEIGHT[0] <= size[2] <= HEIGHT[1] or not BREADTH[0] <= size[:2].max() <= BREADTH[1]:
        return None
    scene = segment(scaled(scan, factor), config, client)
    near = [
        (confidence, height / factor)
        for height, confidence in heights(scene, known.thing)
        if abs(height - known.height) <= NEAR * known.height and confidence > 0.0
    ]
    if not near:
        return None
    confidence, height = max(near)
    usual = float(np.exp(-0.5 * (np.log(size[2] / USUAL_HEIGHT) / SPREAD) ** 2))
    return confidence * (0.1 + usual), height


def scaled(scan: Scan, factor: float) -> Scan:
    """A copy of the scan scaled by a factor."""
    map_ = np.diag([factor, factor, factor, 1.0])
    return replace(
        scan,
        mesh=scan.mesh.transformed(map_),
        world_from_file=map_ @ scan.world_from_file,
        unit_metres=factor * scan.unit_metres,
    )
