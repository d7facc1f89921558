"""Names and recipes of the things to place: builder, file format, the unit they are written in, a plausible mass."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dcap.synthetic.assembly import Assembly
from dcap.synthetic.furniture.seats import sofa
from dcap.synthetic.furniture.tables import wardrobe
from dcap.synthetic.shapes import union
from dcap.synthetic.things import play as objects_play
from dcap.synthetic.things import rigid as objects_rigid
from dcap.synthetic.things import soft as objects_soft


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to make and write one object."""

    build: Callable[[], Assembly]
    """Makes it in metres, z up, standing on z = 0, front towards +y."""
    mass: float
    """What such a thing weighs [kg]; informative, nothing reads it but tests and people."""
    suffix: str = ".glb"
    """.glb (named nodes, y up), .obj or .ply (one mesh, z up)."""
    unit: float = 1.0
    """Length of the file's unit [m]; some files are in a unit of their own, as downloads are."""


def armchair() -> Assembly:
    """A full-size armchair: far too large for a stool."""
    return _melted(sofa(1, (86, 110, 126), (98, 124, 140), 3, "armchair", seat=0.60, depth=0.82, arm=0.16))


def closet() -> Assembly:
    """A full-size wardrobe: far too large for a bedside table."""
    return _melted(wardrobe((196, 152, 104), (206, 164, 116), 4, (1.0, 0.55, 1.9)))


def _melted(item: Assembly) -> Assembly:
    """The solids of each part grown together."""
    return replace(item, parts=tuple(replace(p, solids=(union(p.solids),)) for p in item.parts))


OBJECTS: dict[str, Recipe] = {
    "ball": Recipe(objects_play.toy_ball, 0.30),
    "basketball": Recipe(objects_play.basketball, 0.62),
    "soccer_ball": Recipe(objects_play.soccer_ball, 0.43),
    "tennis_ball": Recipe(objects_play.tennis_ball, 0.058, unit=0.0335),
    "dumbbell": Recipe(objects_play.dumbbell, 4.0),
    "mug": Recipe(objects_rigid.mug, 0.34, unit=0.01),
    "cup": Recipe(objects_rigid.cup, 0.02),
    "bowl": Recipe(objects_rigid.bowl, 0.42),
    "plate": Recipe(objects_rigid.plate, 0.5),
    "book": Recipe(objects_rigid.book, 0.65),
    "laptop": Recipe(objects_rigid.laptop, 1.6),
    "vase": Recipe(objects_rigid.vase, 1.1),
    "apple": Recipe(objects_rigid.apple, 0.19, ".obj", 0.01),
    "tray": Recipe(objects_rigid.tray, 0.8),
    "bottle": Recipe(objects_rigid.bottle, 0.7),
    "remote": Recipe(objects_rigid.remote, 0.12),
    "pencil": Recipe(objects_rigid.pencil, 0.006),
    "pole": Recipe(objects_rigid.pole, 0.19),
    "toy_block": Recipe(objects_play.toy_block, 0.13),
    "candle": Recipe(objects_rigid.candle, 0.36),
    "toy_car": Recipe(objects_play.toy_car, 0.2, unit=0.0254),
    "pillow": Recipe(objects_soft.pillow, 0.8, unit=0.55),
    "cushion": Recipe(objects_soft.cushion, 0.6),
    "plush_bear": Recipe(objects_soft.plush_bear, 0.35),
    "plush_rabbit": Recipe(objects_soft.plush_rabbit, 0.25),
    "folded_towel": Recipe(objects_soft.folded_towel, 0.5, ".ply"),
    "folded_blanket": Recipe(objects_soft.folded_blanket, 1.6),
    "shoe": Recipe(objects_soft.shoe, 0.35),
    "armchair": Recipe(armchair, 22.0),
    "wardrobe": Recipe(closet, 60.0),
}


def build_object(name: str) -> Assembly:
    """The object in its file's own unit, z up."""
    recipe = OBJECTS[name]
    return recipe.build().transformed(np.diag([1 / recipe.unit] * 3 + [1.0]))
