"""The things to place, by their recipes."""

from dataclasses import replace

import numpy as np

from dcap.synthetic.assembly import Assembly
from dcap.synthetic.recipes import ObjectRecipe, object_recipes
from dcap.synthetic.shapes import union


def build_object(name: str) -> Assembly:
    """One of the embedded objects in its file's own unit, z up."""
    return in_file_unit(object_recipes()[name])


def in_file_unit(recipe: ObjectRecipe) -> Assembly:
    """The object of a recipe in its file's own unit, z up."""
    return in_metres(recipe).transformed(np.diag([1 / recipe.unit] * 3 + [1.0]))


def in_metres(recipe: ObjectRecipe) -> Assembly:
    """The object of a recipe, z up, standing on z = 0, front towards +y."""
    built = recipe.piece.build()
    return _fused(built) if recipe.fused else built


def _fused(item: Assembly) -> Assembly:
    """The solids of each part grown together."""
    return replace(item, parts=tuple(replace(p, solids=(union(p.solids),)) for p in item.parts))
