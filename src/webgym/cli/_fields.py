"""Command-line options made from the fields of settings.

Every field can be set by its path, as ``--admission.queues global`` or ``admission.queues=global``. A command
names short options for those that people type::

    OPTIONS = Options(ServerConfig, {"--host": "host", "--ttl": "ttl_seconds"})


    @takes(server=OPTIONS)
    def command(server: Given, verbose: bool = typer.Option(False)) -> None:
        config = validated(ServerConfig, server)

Type, range, choices, default and help text of an option come from its field; the help text is the first
paragraph of the field's docstring. ``--help`` lists the short options, ``--help-all`` all fields.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, Final, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import typer
import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.markup import escape
from typer.core import TyperCommand

from webgym.core.errors import UsageError
from webgym.core.settings import field_docstring, merged

Given: TypeAlias = dict[str, Any]
"""Values of options, nested like their model; fields whose option was not given are absent."""

_SETTING: Final = re.compile(r"--([a-z][a-z0-9_-]*(?:\.[a-z0-9_-]+)+)(?:=(.*))?", re.DOTALL)
"""An option that sets a field by its path; the value may follow as a word of its own."""

_ASSIGNMENT: Final = re.compile(r"[a-z][a-z0-9_]*(?:\.[a-z0-9_]+)*=.*", re.DOTALL)
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
        model: the class of settings, or ``module:class`` if its import takes long and no option is named.
        options: flags, such as ``--sessions`` or ``--marks/--coordinates``, and the field that each sets.
        panel: the heading under which the help lists the options.
    """

    def __init__(
        self,
        model: type[BaseModel] | str,
        options: Mapping[str, str | Option] | None = None,
        *,
        panel: str | None = None,
    ) -> None:
        self._model = model
        self._panel = panel
        self._options = {
            flag: Option(option) if isinstance(option, str) else option
            for flag, option in (options or {}).items()
        }

    @cached_property
    def model(self) -> type[BaseModel]:
        """The class of settings."""
        model: type[BaseModel] = resolve_name(self._model) if isinstance(self._model, str) else self._model
        return model

    def parameters(self) -> list[inspect.Parameter]:
        """A parameter of a Typer command for each option; its default is ``None``, for "not given"."""
        return [self._parameter(flag, option) for flag, option in self._options.items()]

    def given(self, values: Mapping[str, Any]) -> Given:
        """Select the options that were given from a command's arguments, and nest them like the model."""
        given: Given = {}
        for flag, option in self._options.items():
            value = values[_name(flag)]
            if value is not None and value != []:
                given = merged(given, _nested(option.field, option.parse(value) if option.parse else value))
        return given

    def _parameter(self, flag: str, option: Option) -> inspect.Parameter:
        model, name = owner_of(self.model, option.field)
        field = model.model_fields[name]
        kind, is_list, choices = _kind(field.annotation)
        if "/" in flag:
            kind, choices = bool, None
        bounds = {} if kind not in (int, float) or is_list else _bounds(field)
        default = option.default or _default_text(field)
        declaration = typer.Option(
            flag,
            help=option.help or escape(_plain_help(model, name)),
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

    def print_all(requested: bool) -> None:
        if requested:
            for group in groups.values():
                print("\n".join(all_settings(group.model)))
            raise typer.Exit

    listing = typer.Option("--help-all", help=_HELP_ALL, callback=print_all, is_eager=True)
    every = (
        _extra("assignments", Annotated[list[str] | None, _SET]),
        _extra("help_all", Annotated[bool | None, listing]),
    )

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(command, include_extras=True)
        parameters: list[inspect.Parameter] = []
        for name, parameter in inspect.signature(command).parameters.items():
            own = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[name])
            parameters += groups[name].parameters() if name in groups else [own]
        parameters += every

        def wrapped(*, assignments: Sequence[str] | None, **values: Any) -> None:
            given = {name: group.given(values) for name, group in groups.items()}
            for assignment in assignments or ():
                name = _group_of(assignment, groups)
                given[name] = merged(given[name], _assigned(assignment))
            own = {name: value for name, value in values.items() if name in hints}
            command(**own | given)

        wrapped.__name__, wrapped.__doc__ = command.__name__, command.__doc__
        wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate


_SET: Final = typer.Option(
    "--set",
    metavar="KEY=VALUE",
    show_default=False,
    help="Any other setting by its path; also --KEY VALUE or KEY=VALUE. --help-all lists them.",
)
_HELP_ALL: Final = "Print all settings with their defaults and exit."


def _extra(name: str, annotation: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


class SettingsCommand(TyperCommand):
    """A command that also takes ``--section.key VALUE`` and ``section.key=VALUE``, if it takes settings."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Rewrite settings as values of ``--set``."""
        options = {flag: each for each in self.params for flag in (*each.opts, *each.secondary_opts)}
        if "--set" not in options:
            return super().parse_args(ctx, args)
        words: list[str] = []
        rest = iter(args)
        for word in rest:
            if setting := _SETTING.fullmatch(word):
                value = setting[2] if setting[2] is not None else next(rest, None)
                if value is None:
                    raise UsageError(f"{word} has no value", hint=f"{word} VALUE")
                words += ["--set", f"{setting[1].replace('-', '_')}={value}"]
            elif _ASSIGNMENT.fullmatch(word):
                words += ["--set", word]
            else:
                words.append(word)
                option = options.get(word)
                if option is not None and not getattr(option, "is_flag", False):
                    words += [value for value in [next(rest, None)] if value is not None]
        return super().parse_args(ctx, words)


def _group_of(assignment: str, groups: Mapping[str, Options]) -> str:
    """The group that has the section of an assignment; the first one, which will refuse it, if none has."""
    if len(groups) == 1:  # whose class may take seconds to import
        return next(iter(groups))
    section = re.split(r"[.=]", assignment)[0]
    known = (name for name, group in groups.items() if section in group.model.model_fields)
    return next(known, next(iter(groups)))


def _assigned(assignment: str) -> Given:
    """``KEY=VALUE`` in the shape of settings. Lists, sections and ``null`` are YAML, other values text."""
    key, equals, text = assignment.partition("=")
    if not equals:
        raise UsageError(f"--set {assignment!r} is not KEY=VALUE", hint="such as --set seed=3")
    try:
        value = yaml.safe_load(text) if text == "null" or text[:1] in ("[", "{") else text
    except yaml.YAMLError as error:
        raise UsageError(f"{key}: {text!r} is not YAML", hint="such as [1, 2] or {a: 1}") from error
    return _nested(key, value)


def _nested(path: str, value: Any) -> Given:
    """A value at a dotted path."""
    for name in reversed(path.split(".")):
        value = {name: value}
    nested: Given = value
    return nested


def all_settings(model: type[BaseModel], section: str = "") -> Iterator[str]:
    """Two lines for each field of settings and of their sections: path with default, and help."""
    for name, field in model.model_fields.items():
        inner = _section(field)
        if inner is not None:
            yield from all_settings(inner, f"{section}{name}.")
            continue
        yield f"{section}{name}={_default_text(field)}"
        yield f"    {_plain_help(model, name)}"


def _section(field: FieldInfo) -> type[BaseModel] | None:
    """The class of the settings that a field holds, if it is a section."""
    types_of = (kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type))
    is_container = get_origin(field.annotation) in (tuple, list, dict, set, frozenset)
    return None if is_container else next((each for each in types_of if issubclass(each, BaseModel)), None)


def owner_of(model: type[BaseModel], path: str) -> tuple[type[BaseModel], str]:
    """The model and the name of the field at a dotted path, such as ``policy.chat.model``."""
    name, _, rest = path.partition(".")
    if not rest:
        return model, name
    section = _section(model.model_fields[name])
    assert section is not None, path
    return owner_of(section, rest)


def _plain_help(model: type[BaseModel], name: str) -> str:
    """The first paragraph of a field's docstring, without reStructuredText markup."""
    paragraph = re.split(r"\n\s*\n", field_docstring(model, name))[0]
    return " ".join(_CODE.sub(r"\1", _ROLE.sub(r"\1", paragraph)).split())


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


def _default_text(field: FieldInfo) -> str:
    """A default as the help shows it: numbers, strings and paths; empty for every other value."""
    default = field.get_default(call_default_factory=True, validated_data={})
    is_shown = isinstance(default, int | float | str | Path) and not isinstance(default, bool)
    return str(default) if is_shown else ""
