"""A mypy plugin that derives the signature of a stage's task from the signature of its function.

Where the function takes a value of the pipeline (a type of dcap/scene/types, or a Source), the task takes a `Ref` of
it; user input (dcap.scene.types.sample), an end pose, a viewpoint and plain values stay as they are; the runner
supplies `client`. Without this plugin a task accepts anything, so other type checkers still know its return type.
"""

from collections.abc import Callable

from mypy.nodes import TypeInfo
from mypy.plugin import FunctionContext, Plugin
from mypy.types import CallableType, Instance, Parameters, Type, UnionType, get_proper_type

STAGE = "tasks.cache.stage"
REF = "tasks.artifact.Ref"
VALUES = ("dcap.scene.types.", "tasks.artifact.Source")
PLAIN = (
    "dcap.scene.types.sample.", "dcap.scene.types.settled.EndPose", "dcap.scene.types.pictures.Viewpoint",
)  # fmt: skip
OWN = "client"


class StagePlugin(Plugin):
    """Handles `tasks.cache.stage`."""

    def get_function_hook(self, fullname: str) -> Callable[[FunctionContext], Type] | None:
        """The hook for a function, if it is `stage`."""
        return self.typed_stage if fullname == STAGE else None

    def typed_stage(self, context: FunctionContext) -> Type:
        """`Stage[[Ref[A], ...], R]` for a function that takes A, ... and returns R or an Infeasible."""
        default = get_proper_type(context.default_return_type)
        function = get_proper_type(context.arg_types[0][0])
        if not isinstance(default, Instance) or not isinstance(function, CallableType):
            return default
        kept = [i for i, name in enumerate(function.arg_names) if name != OWN]
        signature = Parameters(
            [self.referred(function.arg_types[i]) for i in kept],
            [function.arg_kinds[i] for i in kept],
            [function.arg_names[i] for i in kept],
        )
        return default.copy_modified(args=[signature, default.args[1]])

    def referred(self, declared: Type) -> Type:
        """The type of a task's argument for a parameter of the function."""
        proper = get_proper_type(declared)
        if isinstance(proper, UnionType):
            return UnionType.make_union([self.referred(item) for item in proper.items])
        if isinstance(proper, Instance):
            name = proper.type.fullname
            if name.startswith(VALUES) and not name.startswith(PLAIN):
                found = self.lookup_fully_qualified(REF)
                assert found is not None
                assert isinstance(found.node, TypeInfo)
                return Instance(found.node, [proper])
        return proper


def plugin(version: str) -> type[Plugin]:
    """Entry point for mypy."""
    return StagePlugin
