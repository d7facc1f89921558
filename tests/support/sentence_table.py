"""Sentences with what a person expects of them, and how well the stages up to the anchor do what they ask."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from shapely import Polygon

from dcap.geometry.placement.polygons import convex_hull
from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import LanguageError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from perf.aims import PICTURES, item_of, room_of
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig, intent
from tasks.rotation.stage import rotation

Row = Mapping[str, Any]
SHARED = 0.05
"""Share of an object's plan that may lie over or under a thing that it is to be clear of [-]."""
SLACK = 0.03
"""Boxes of scanned things and samples of places are uncertain by about this [m]."""


@dataclass(frozen=True, slots=True)
class Score:
    """What became of a sentence."""

    end: str
    """at, ask, refuse, missing or infeasible."""
    faults: tuple[str, ...]
    """What is not as it was asked."""
    said: str
    """What a person is told."""

    @property
    def silent(self) -> bool:
        """Whether something is wrong without a word."""
        return bool(self.faults) and self.end == "at" and not self.said


def score(row: Row, *, whole: bool = True) -> Score:
    """Intent, and with `whole` rotation and anchor, of a sentence in an embedded room."""
    scene, item = room_of(row["room"])[1], item_of(row["object"])
    wanted = str(row.get("end", "at")).split()
    try:
        meant = intent(
            SegmentedScene(scene), SegmentedObject(item), row["prompt"], None, IntentConfig(), OfflineClient()
        )
    except LanguageError as error:
        return refused(row, wanted, str(error))
    if isinstance(meant, Infeasible):
        end = "missing" if meant.reason is Reason.TARGET_NOT_FOUND else "infeasible"
        return Score(end, () if end in wanted else (f"{end} instead of {wanted}",), meant.message)
    said = "; ".join(meant.not_understood)
    faults = [] if "at" in wanted else [f"placed on {meant.base_id} instead of {wanted}"]
    if faults or not whole:
        faults += base_faults(row, meant.base_id)
        return Score("at", tuple(faults), said)
    turned = rotation(SegmentedScene(scene), SegmentedObject(item), meant, row["prompt"], PICTURES, OfflineClient())
    assert not isinstance(turned, Infeasible)
    found = anchor(
        SegmentedScene(scene), SegmentedObject(item), meant, turned, row["prompt"], AnchorConfig(), OfflineClient()
    )
    if isinstance(found, Infeasible):
        return Score("infeasible", () if "infeasible" in wanted else ("infeasible",), found.message)
    return Score("at", tuple(place_faults(row, scene, item, meant, found)), said)


def refused(row: Row, wanted: list[str], said: str) -> Score:
    """A refusal or a question back."""
    end = "ask" if said.startswith("which") else "refuse"
    faults = () if end in wanted else (f"{end} instead of {wanted}",)
    unlisted = [one for one in row.get("asks", ()) if f"id {one}" not in said]
    return Score(end, (*faults, *(f"{one} is not listed" for one in unlisted)), said)


def base_faults(row: Row, base: str) -> list[str]:
    """Whether another thing carries it."""
    return [] if base in row.get("base", [base]) else [f"base {base} instead of {row['base']}"]


def place_faults(row: Row, scene: Segmentation, item: Segmentation, meant: Intent, found: Anchor) -> list[str]:
    """What is wrong with where it is aimed at."""
    mesh = item.mesh.transformed(found.world_from_object)
    low, high = mesh.bounds[:, :2]
    middle = 0.5 * (low + high)
    faults = base_faults(row, found.base_id)
    if "part" in row and found.part != row["part"]:
        faults.append(f"part {found.part}")
    for axis, name in enumerate("xy"):
        if name in row and not row[name][0] - SLACK <= middle[axis] <= row[name][1] + SLACK:
            faults.append(f"{name} {middle[axis]:.2f} not in {row[name]}")
    if "xnot" in row and row["xnot"][0] < middle[0] < row["xnot"][1]:
        faults.append(f"x {middle[0]:.2f} in {row['xnot']}")
    if "height" in row and abs(found.surface_point[2] - row["height"]) > 2 * SLACK:
        faults.append(f"height {found.surface_point[2]:.2f}")
    faults += [f"height {z}" for z in row.get("notheight", ()) if abs(found.surface_point[2] - z) < 2 * SLACK]
    for name, (least, most) in row.get("gap", {}).items():
        plan = Polygon(convex_hull(mesh.vertices[:, :2]))
        away = min(plan.distance(Polygon(box.corners[:4, :2])) for box in boxes_of(scene, name))
        if not least - SLACK <= away <= most + SLACK:
            faults.append(f"{away:.2f} m from {name}")
    for name in row.get("clear", ()):
        plan = Polygon(convex_hull(mesh.vertices[:, :2]))
        shared = max(plan.intersection(Polygon(box.corners[:4, :2])).area for box in boxes_of(scene, name))
        if shared > SHARED * plan.area:
            faults.append(f"over or under {name}")
    if "rim" in row:
        side, rim = np.array(row["rim"]["side"]), row["rim"]["at"]
        outer = max(float(corner @ side) for corner in (low, high, (low[0], high[1]), (high[0], low[1])))
        away = rim * float(side.sum()) - outer
        if not row["rim"]["gap"][0] <= away <= row["rim"]["gap"][1]:
            faults.append(f"{away:.2f} m from the rim")
    if "lean" in row:
        faults += lean_faults(row["lean"], meant)
    return faults


def lean_faults(wanted: str, meant: Intent) -> list[str]:
    """Whether it leans on something else, or on nothing."""
    lean = str(getattr(meant.orientation, "lean", ""))
    return [] if lean and lean.startswith(wanted) else [f"leans on {lean or 'nothing'}"]


def boxes_of(scene: Segmentation, name: str) -> list[OrientedBox]:
    """The box of an instance, or of its parts of a name ("255/pillow")."""
    one, _, part = name.partition("/")
    instance = scene.instances[scene.index_of(one)]
    return [piece.box for piece in instance.parts if piece.name == part] if part else [instance.box]
