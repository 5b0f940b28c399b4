"""Command-line options made from the fields of settings.

A command declares its options and which field each of them sets. Type, range, choices, default and help text
come from the field; the help text is the first paragraph of the field's docstring::

    OPTIONS = Options(ServerConfig, {"--host": "host", "--ttl": "ttl_seconds"})


    @takes(server=OPTIONS)
    def command(server: Given, verbose: bool = typer.Option(False)) -> None:
        config = validated(ServerConfig, server)
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.markup import escape

from webgym.core.settings import field_docstring

Given: TypeAlias = dict[str, Any]
"""Values of options, nested like their model; fields whose option was not given are absent."""

_ROLE: Final = re.compile(r":\w+:`~?([^`]*)`")
_CODE: Final = re.compile(r"``([^`]*)``")


@dataclass(frozen=True, slots=True)
class Option:
    """An option that differs from what its field says.

    Attributes:
        field: the field's path in the model, with dots.
        default: the default that the help shows; by default the field's.
        help: the help text; by default the field's docstring.
        metavar: the placeholder of the value in the help; by default the field's type.
        parse: converts the value from the command line into the field's value.
    """

    field: str
    default: str | None = None
    help: str = ""
    metavar: str | None = None
    parse: Callable[[Any], Any] | None = None


class Options:
    """The options of a command that set fields of one model.

    Args:
        model: the class of settings.
        options: flags, such as ``--sessions`` or ``--marks/--coordinates``, and the field that each sets.
        panel: the heading under which the help lists the options.
    """

    def __init__(
        self, model: type[BaseModel], options: Mapping[str, str | Option], *, panel: str | None = None
    ) -> None:
        self._model = model
        self._panel = panel
        self._options = {
            flag: Option(option) if isinstance(option, str) else option for flag, option in options.items()
        }

    def parameters(self) -> list[inspect.Parameter]:
        """A parameter of a Typer command for each option; its default is ``None``, for "not given"."""
        return [self._parameter(flag, option) for flag, option in self._options.items()]

    def given(self, values: Mapping[str, Any]) -> Given:
        """Select the options that were given from a command's arguments, and nest them like the model."""
        given: Given = {}
        for flag, option in self._options.items():
            value = values[_name(flag)]
            if value is None or value == []:
                continue
            *sections, name = option.field.split(".")
            target = given
            for section in sections:
                target = target.setdefault(section, {})
            target[name] = option.parse(value) if option.parse else value
        return given

    def _parameter(self, flag: str, option: Option) -> inspect.Parameter:
        model, name = owner_of(self._model, option.field)
        field = model.model_fields[name]
        kind, is_list, choices = _kind(field.annotation)
        if "/" in flag:
            kind, choices = bool, None
        bounds = {} if kind not in (int, float) or is_list else _bounds(field)
        default = option.default or _default_text(
            field.get_default(call_default_factory=True, validated_data={})
        )
        declaration = typer.Option(
            flag,
            help=option.help or help_of(model, name),
            show_default=default or False,
            metavar=option.metavar or choices,
            rich_help_panel=self._panel,
            **bounds,
        )
        return inspect.Parameter(
            _name(flag),
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[list[kind] | None if is_list else kind | None, declaration],  # type: ignore[valid-type]
        )


def takes(**groups: Options) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a Typer command with options that set fields of models.

    Args:
        groups: options by the name of the command's parameter that receives their values, as :data:`Given`.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(command, include_extras=True)
        parameters: list[inspect.Parameter] = []
        for name, parameter in inspect.signature(command).parameters.items():
            own = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[name])
            parameters += groups[name].parameters() if name in groups else [own]

        def wrapped(**values: Any) -> None:
            given = {name: group.given(values) for name, group in groups.items()}
            own = {name: value for name, value in values.items() if name in hints}
            command(**own | given)

        wrapped.__name__, wrapped.__doc__ = command.__name__, command.__doc__
        wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate


def owner_of(model: type[BaseModel], path: str) -> tuple[type[BaseModel], str]:
    """The model and the name of the field at a dotted path, such as ``policy.chat.model``."""
    name, _, rest = path.partition(".")
    if not rest:
        return model, name
    field = model.model_fields[name]
    types_of = (kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type))
    return owner_of(next(kind for kind in types_of if issubclass(kind, BaseModel)), rest)


def help_of(model: type[BaseModel], name: str) -> str:
    """The first paragraph of a field's docstring, without reStructuredText markup."""
    paragraph = re.split(r"\n\s*\n", field_docstring(model, name))[0]
    return escape(" ".join(_CODE.sub(r"\1", _ROLE.sub(r"\1", paragraph)).split()))


def _name(flag: str) -> str:
    return flag.split("/")[0].lstrip("-").replace("-", "_")


def _kind(annotation: Any) -> tuple[type, bool, str | None]:
    """The type of an option's value, whether it may be repeated, and its choices.

    The value of an option whose field takes several types is a string, which validation converts.
    """
    if get_origin(annotation) is Annotated:
        return _kind(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        kinds = [kind for kind in get_args(annotation) if kind is not type(None)]
        return _kind(kinds[0]) if len(kinds) == 1 else (str, False, None)
    if get_origin(annotation) is Literal:
        return str, False, "|".join(get_args(annotation))
    if get_origin(annotation) is tuple and get_args(annotation)[-1] is Ellipsis:
        return _kind(get_args(annotation)[0])[0], True, None
    return annotation if annotation in (bool, int, float, Path) else str, False, None


def _bounds(field: FieldInfo) -> dict[str, Any]:
    """The range of a number, as far as Typer can express it; validation checks the rest."""
    bounds: dict[str, Any] = {}
    for constraint in field.metadata:
        if (least := getattr(constraint, "ge", None)) is not None:
            bounds["min"] = least
        elif isinstance(above := getattr(constraint, "gt", None), int) and field.annotation in (
            int,
            int | None,
        ):
            bounds["min"] = above + 1
        if (most := getattr(constraint, "le", None)) is not None:
            bounds["max"] = most
    return bounds


def _default_text(default: Any) -> str:
    """A default as the help shows it: numbers, strings and paths; empty for every other value."""
    return (
        str(default)
        if isinstance(default, int | float | str | Path) and not isinstance(default, bool)
        else ""
    )
