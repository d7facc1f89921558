"""Checks of recipes: a builder function is its own schema, with its parameters as keys.

A recipe names a function and gives its arguments, `NAME` or `{NAME: {PARAMETER: VALUE, ...}}`; `choice_of` makes the
pydantic model for a table of such functions from their signatures. Unknown keys are errors that name the nearest known
key.
"""

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import is_dataclass
from typing import Annotated, Any, ClassVar, TypeVar, get_type_hints

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    NonNegativeInt,
    PositiveFloat,
    Tag,
    ValidationInfo,
    create_model,
    model_validator,
)

from dcap.scene.text import did_you_mean
from dcap.synthetic import paint
from dcap.synthetic.paint import Finish, Painter, Rgb, plain
from dcap.synthetic.shapes import Assembly, Size


class RecipeModel(BaseModel):
    """A mapping of a recipe."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, given: object) -> object:
        for key in given if isinstance(given, Mapping) else ():
            check_known("key", key, cls.model_fields)
        return given


def check_known(kind: str, word: object, known: Collection[str]) -> None:
    """Raise ValueError for an unknown word, with the nearest known word."""
    if word not in known:
        hint = did_you_mean(word, known) or f"; known are {', '.join(known) or 'none'}"
        raise ValueError(f"unknown {kind} {word!r}{hint}")


class FunctionChoice(RecipeModel):
    """A function of a table and its checked arguments."""

    functions: ClassVar[Mapping[str, Callable[..., object]]] = {}

    @model_validator(mode="before")
    @classmethod
    def _one_name(cls, given: object) -> object:
        given = {given: {}} if isinstance(given, str) else given
        if not isinstance(given, Mapping) or len(given) != 1:
            raise ValueError("expected NAME or {NAME: {PARAMETER: VALUE, ...}}")
        name, parameters = next(iter(given.items()))
        check_known("name", name, cls.functions)
        return {name: {} if parameters is None else parameters}

    @property
    def name(self) -> str:
        """The chosen name."""
        return next(iter(self.model_fields_set))

    @property
    def arguments(self) -> dict[str, object]:
        """Every argument by its parameter, including defaults."""
        return dict(getattr(self, self.name))


class PieceChoice(FunctionChoice):
    """A builder of furniture or of an object."""

    def build(self, **changed: object) -> Assembly:
        """Run the builder with the arguments, some of them replaced."""
        built = self.functions[self.name](**(self.arguments | changed))
        assert isinstance(built, Assembly)
        return built


class PatternChoice(FunctionChoice):
    """A pattern of colours."""

    def painter(self) -> Painter:
        """The pattern as a function of position."""
        made: Painter = self.functions[self.name](**self.arguments)  # type: ignore[assignment]
        return made


AnyChoice = TypeVar("AnyChoice", bound=FunctionChoice)


def choice_of(base: type[AnyChoice], functions: Iterable[Callable[..., object]]) -> type[AnyChoice]:
    """The model whose values each name one of the functions."""
    table = {function.__name__: function for function in functions}
    fields: dict[str, Any] = {name: (parameters_of(function) | None, None) for name, function in table.items()}
    model = create_model(base.__name__, __base__=base, **fields)
    model.functions = table
    return model


def parameters_of(function: Callable[..., object]) -> type[RecipeModel]:
    """A model with one field for each parameter of a function or dataclass."""
    hints = get_type_hints(function)
    fields: dict[str, Any] = {
        name: (_field_type(hints[name]), ... if one.default is one.empty else one.default)
        for name, one in inspect.signature(function).parameters.items()
    }
    return create_model(function.__name__, __base__=RecipeModel, **fields)


def _field_type(hint: Any) -> Any:
    """The type of a recipe's value for a parameter: numbers are positive, colours have names."""
    if isinstance(hint, type) and is_dataclass(hint):
        return Annotated[parameters_of(hint), AfterValidator(lambda given: hint(**dict(given)))]
    return FIELD_TYPES.get(hint, hint)


# ---- colours and patterns --------------------------------------------------------------------------------------


def _by_name(given: object, info: ValidationInfo) -> object:
    """The colour of a name of the palette, which is the context of the validation."""
    palette: Mapping[str, object] = info.context or {}
    if not isinstance(given, str):
        return given
    check_known("colour", given, palette)
    return palette[given]


Channel = Annotated[float, Field(ge=0, le=255)]
Color = Annotated[tuple[Channel, Channel, Channel], BeforeValidator(_by_name)]
"""sRGB, 0 to 255, or a name of the palette."""

FIELD_TYPES: dict[Any, Any] = {
    float: PositiveFloat,
    int: NonNegativeInt,
    Size: tuple[PositiveFloat, PositiveFloat, PositiveFloat],
    Rgb: Color,
}
"""Types of a recipe's values by the type of the parameter."""

PATTERNS = choice_of(PatternChoice, (paint.checks, paint.dots, paint.planks, paint.stripes, paint.tiles))
Pattern: Any = Annotated[PATTERNS, AfterValidator(PatternChoice.painter)]
FinishField: Any = Annotated[
    Annotated[Color, Tag("color")] | Annotated[Pattern, Tag("pattern")],
    Discriminator(lambda given: "pattern" if isinstance(given, Mapping) else "color"),
]
FIELD_TYPES |= {
    Painter: Annotated[FinishField, AfterValidator(lambda given: given if callable(given) else plain(given))],
    Finish: FinishField,
    Finish | None: FinishField | None,
}
