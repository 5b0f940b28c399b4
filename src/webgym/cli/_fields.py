"""Command-line options made from the fields of settings.

A verb names its options and the field that each sets. Type, range, choices, default and help come from the
field; the help is the first paragraph of its docstring::

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

Given: TypeAlias = dict[str, Any]
"""What options say, in the shape of their model; fields whose option was not given are absent."""

_ROLE: Final = re.compile(r":\w+:`~?([^`]*)`")
_CODE: Final = re.compile(r"``([^`]*)``")


@dataclass(frozen=True, slots=True)
class Option:
    """An option whose field does not say everything.

    Attributes:
        field: the field's path in the model, with dots.
        default: shown in place of the field's default.
        help: shown in place of the field's docstring, where several options set a field of this kind.
        metavar: shown in place of the field's type.
        parse: turns the value given on the command line into the field's.
    """

    field: str
    default: str | None = None
    help: str = ""
    metavar: str | None = None
    parse: Callable[[Any], Any] | None = None


class Options:
    """The options of a command that set fields of one model.

    Args:
        model: the settings' class.
        options: by flag, such as ``--sessions`` or ``--marks/--coordinates``: the field that it sets.
        panel: heading under which the help lists them.
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
        """One parameter of a Typer command per option. Its default is the absence of a value."""
        return [self._parameter(flag, option) for flag, option in self._options.items()]

    def given(self, values: Mapping[str, Any]) -> Given:
        """The values of a command's parameters, in the shape of the model."""
        given: Given = {}
        for flag, option in self._options.items():
            value = values[_name(flag)]
            if value is None or value == []:
                continue
            *sections, name = option.field.split(".")
            place = given
            for section in sections:
                place = place.setdefault(section, {})
            place[name] = option.parse(value) if option.parse else value
        return given

    def _parameter(self, flag: str, option: Option) -> inspect.Parameter:
        field = field_of(self._model, option.field)
        kind, is_list, choices = _kind(field.annotation)
        if "/" in flag:
            kind, choices = bool, None
        bounds = {} if kind not in (int, float) or is_list else _bounds(field)
        default = option.default or _shown(field.get_default(call_default_factory=True, validated_data={}))
        told = typer.Option(
            flag,
            help=option.help or help_of(field),
            show_default=default or False,
            metavar=option.metavar or choices,
            rich_help_panel=self._panel,
            **bounds,
        )
        return inspect.Parameter(
            _name(flag),
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[list[kind] | None if is_list else kind | None, told],  # type: ignore[valid-type]
        )


def takes(**groups: Options) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of models.

    Args:
        groups: by the name of the command's parameter that receives what the options say, as :data:`Given`.
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
        wrapped.__annotations__ = {each.name: each.annotation for each in parameters}
        return wrapped

    return decorate


def field_of(model: type[BaseModel], path: str) -> FieldInfo:
    """The field of a model, or of one of its sections, that a path with dots names."""
    name, _, rest = path.partition(".")
    field = model.model_fields[name]
    if not rest:
        return field
    sections = (each for each in (field.annotation, *get_args(field.annotation)) if isinstance(each, type))
    return field_of(next(each for each in sections if issubclass(each, BaseModel)), rest)


def help_of(field: FieldInfo) -> str:
    """The first paragraph of a field's docstring, without its markup."""
    paragraph = re.split(r"\n\s*\n", (field.description or "").strip())[0]
    return escape(" ".join(_CODE.sub(r"\1", _ROLE.sub(r"\1", paragraph)).split()))


def _name(flag: str) -> str:
    return flag.split("/")[0].lstrip("-").replace("-", "_")


def _kind(annotation: Any) -> tuple[type, bool, str | None]:
    """The type of an option's value, whether it may be repeated, and its choices.

    Where a field takes values of several types, the option's value is a text: validation reads it.
    """
    if get_origin(annotation) is Annotated:
        return _kind(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        kinds = [each for each in get_args(annotation) if each is not type(None)]
        return _kind(kinds[0]) if len(kinds) == 1 else (str, False, None)
    if get_origin(annotation) is Literal:
        return str, False, "|".join(get_args(annotation))
    if get_origin(annotation) is tuple and get_args(annotation)[-1] is Ellipsis:
        return _kind(get_args(annotation)[0])[0], True, None
    return annotation if annotation in (bool, int, float, Path) else str, False, None


def _bounds(field: FieldInfo) -> dict[str, Any]:
    """The range of a number; what Typer cannot express is left to validation."""
    bounds: dict[str, Any] = {}
    for each in field.metadata:
        if (least := getattr(each, "ge", None)) is not None:
            bounds["min"] = least
        elif isinstance(above := getattr(each, "gt", None), int) and field.annotation in (int, int | None):
            bounds["min"] = above + 1
        if (most := getattr(each, "le", None)) is not None:
            bounds["max"] = most
    return bounds


def _shown(default: Any) -> str:
    """A default as the help shows it; nothing for none, and for one that validation would miss."""
    return (
        str(default)
        if isinstance(default, int | float | str | Path) and not isinstance(default, bool)
        else ""
    )
