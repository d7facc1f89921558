"""Compares a segmentation with the truth of a generated room: intersection over union of areas.

Truth and result are given face by face on the same mesh. Each true instance is compared with one found instance, such
that the sum of overlaps is largest: annotations lack ids, which therefore cannot be used.

A found label is right if it is the same word, a synonym, or a kind of the true label by the lexicon: a "sofa" for a
"multi person sofa", a "cabinet" for a "shoe cabinet", a "table" for a "desk".
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from dcap.knowledge.lexicon import in_line, thing_of
from dcap.scene.types.segmentation import Segmentation


@dataclass(frozen=True, eq=False, slots=True)
class GroundTruth:
    """The true instance and part of each face of a mesh."""

    ids: tuple[str, ...]
    labels: tuple[str, ...]
    face_instance: NDArray[np.int32]
    """Index of the instance of each face, shape (m,)."""
    face_part: NDArray[np.object_]
    """Part name of each face, shape (m,)."""


@dataclass(frozen=True, slots=True)
class Score:
    """One instance of the truth."""

    id: str
    label: str
    found_id: str
    """Empty: nothing overlaps it."""
    found_label: str
    iou: float
    parts: tuple[tuple[str, float], ...]
    """IoU of each true part with the part of the same name in the found instance."""


def overlaps(truth: GroundTruth, found: Segmentation) -> NDArray[np.float64]:
    """IoU of every true with every found instance, shape (true, found)."""
    area = found.mesh.face_areas
    rows, columns = len(truth.ids), len(found.instances)
    key = truth.face_instance.astype(np.int64) * (columns + 1) + found.face_instance + 1
    both = np.bincount(key, area, rows * (columns + 1)).reshape(rows, columns + 1)
    union = both.sum(axis=1)[:, None] + both.sum(axis=0)[None] - both
    return np.asarray((both / np.maximum(union, 1e-12))[:, 1:], dtype=np.float64)


def scores(truth: GroundTruth, found: Segmentation) -> list[Score]:
    """A row for each true instance that has faces, in order."""
    iou = overlaps(truth, found)
    partner = dict(zip(*(index.tolist() for index in linear_sum_assignment(iou, maximize=True)), strict=True))
    present = np.unique(truth.face_instance)
    return [_score(truth, found, int(i), partner.get(int(i), -1), iou) for i in present]


def _score(truth: GroundTruth, found: Segmentation, true: int, other: int, iou: NDArray[np.float64]) -> Score:
    if other < 0 or iou[true, other] == 0.0:
        names = sorted(set(truth.face_part[truth.face_instance == true].tolist()))
        return Score(truth.ids[true], truth.labels[true], "", "", 0.0, tuple((name, 0.0) for name in names))
    one = found.instances[other]
    return Score(
        truth.ids[true], truth.labels[true], one.id, one.label, float(iou[true, other]),
        _part_scores(truth, found, true, other),
    )  # fmt: skip


def _part_scores(truth: GroundTruth, found: Segmentation, true: int, other: int) -> tuple[tuple[str, float], ...]:
    """IoU by part name; parts of one name count together."""
    area = found.mesh.face_areas
    mine, there = found.face_instance == other, truth.face_instance == true
    names = np.array([part.name for part in found.instances[other].parts], dtype=object)
    found_name = np.where(mine, names[np.where(mine, found.face_part, 0)], "")
    result = []
    for name in sorted(set(truth.face_part[there].tolist())):
        a, b = found_name == name, there & (truth.face_part == name)
        result.append((name, float(area[a & b].sum() / max(area[a | b].sum(), 1e-12))))
    return tuple(result)


def means_the_same(found: str, true: str) -> bool:
    """Whether two labels name the same kind of thing, one perhaps more exactly."""
    a, b = thing_of(found), thing_of(true)
    return found == true or (a is not None and b is not None and in_line(a.id, b.id))


def label_accuracy(rows: Sequence[Score]) -> float:
    """Share of the true things whose found label is right; things that were not found count as wrong. 1 for no
    things."""
    return float(np.mean([means_the_same(row.found_label, row.label) for row in rows])) if rows else 1.0
