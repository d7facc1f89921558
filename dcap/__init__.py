"""Deformable, contact-aware object placement, for notebooks and other programs.

    import dcap

    placement = dcap.place("table.glb", "mug.obj", "put the mug near the left edge", label="table")
    result = dcap.drop("case.yaml", resolution=0.01)

`place` takes a scene, an object and a sentence, `drop` a case file or the same structure as a dict, `settle` the
arrays of the solver. Nothing is printed; what is wrong with an input is an `InputError` or another `DcapError`. The
names below are the whole face (docs/python.md); they are loaded when first used: importing `dcap` costs nothing.
"""

from typing import TYPE_CHECKING

from dcap.packages import claim_companions

if TYPE_CHECKING:
    from dcap.scene.errors import (
        BudgetError,
        DcapError,
        FormatError,
        GeometryError,
        InputError,
        LanguageError,
        MachineError,
        StoreError,
    )
    from flows.api import drop, place
    from flows.results import Placement, Result
    from solver.config import SolverConfig
    from solver.errors import SolverError
    from solver.model.bodies import Interior, Model, RigidBody, SignedDistance, SoftBody
    from solver.result import SettledModel
    from solver.settle import settle

    __version__: str

__all__ = [
    "BudgetError",
    "DcapError",
    "FormatError",
    "GeometryError",
    "InputError",
    "Interior",
    "LanguageError",
    "MachineError",
    "Model",
    "Placement",
    "Result",
    "RigidBody",
    "SettledModel",
    "SignedDistance",
    "SoftBody",
    "SolverConfig",
    "SolverError",
    "StoreError",
    "__version__",
    "drop",
    "place",
    "settle",
]

HOMES = {
    "dcap.scene.errors": (
        "BudgetError", "DcapError", "FormatError", "GeometryError", "InputError", "LanguageError", "MachineError",
        "StoreError",
    ),
    "flows.api": ("drop", "place"),
    "flows.results": ("Placement", "Result"),
    "solver.config": ("SolverConfig",),
    "solver.errors": ("SolverError",),
    "solver.model.bodies": ("Interior", "Model", "RigidBody", "SignedDistance", "SoftBody"),
    "solver.result": ("SettledModel",),
    "solver.settle": ("settle",),
}  # fmt: skip
"""Where the names of the face live; the one place from which `dcap` reaches up, and only when asked."""

claim_companions()

if not TYPE_CHECKING:  # a checker that saw this function would believe in any name

    def __getattr__(name):
        """Load a name of the face when it is first used."""
        from importlib import import_module

        if name == "__version__":
            value = import_module("dcap.scene.settings").version()
        else:
            home = next((home for home, names in HOMES.items() if name in names), None)
            if home is None:
                raise AttributeError(f"module 'dcap' has no attribute {name!r}")
            with import_module("dcap.quiet_imports").quiet_imports():
                value = getattr(import_module(home), name)
        globals()[name] = value
        return value

    def __dir__():
        """The names of the face, for completion."""
        return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
