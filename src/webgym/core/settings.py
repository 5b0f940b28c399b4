"""Configuration: reading settings from files and options, merging them key by key, and reporting errors.

Setting one key of a section keeps its other keys, wherever they come from: from the defaults of a
settings class (:class:`Section`), from another file or from options (:func:`merged`), or from the recommended
sampling of a model family (:meth:`webgym.llm.config.Sampling.over`).
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, get_args

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError, model_validator

from webgym.core.consent import confirm
from webgym.core.errors import ConfigError, WebGymError

S = TypeVar("S", bound=BaseModel)


class Settings(BaseModel):
    """Base class of settings: immutable; unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def field_docstring(model: type[BaseModel], name: str) -> str:
    """The docstring under a field of a class of settings, or an empty string.

    It is read from the source when it is asked for: Pydantic would read those of all fields at every start.
    """
    ours = (base for base in model.__mro__ if issubclass(base, Settings))
    return next(filter(None, (_docstrings(base.__module__).get((base.__name__, name)) for base in ours)), "")


@cache
def _docstrings(module: str) -> dict[tuple[str, str], str]:
    """The docstrings of the fields of a module's classes, by class and field."""
    return {
        (made.name, field.target.id): inspect.cleandoc(about.value.value)
        for made in ast.parse(inspect.getsource(sys.modules[module])).body
        if isinstance(made, ast.ClassDef)
        for field, about in pairwise(made.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(about, ast.Expr)
        and isinstance(about.value, ast.Constant)
        and isinstance(about.value.value, str)
    }


class Section(Settings):
    """Settings whose fields are merged with their defaults when only some of their keys are set.

    If a field's default is a section that sets something, or a mapping, a value is merged into that default.
    (Pydantic alone would replace the default.)
    """

    @model_validator(mode="before")
    @classmethod
    def _over_defaults(cls, given: Any) -> Any:
        if not isinstance(given, Mapping):
            return given
        values = dict(given)
        for name, field in cls.model_fields.items():
            default = field.get_default(call_default_factory=True, validated_data={})
            if (
                name in values
                and isinstance(default, BaseModel | Mapping)
                and (default_values := set_values(default))
            ):
                values[name] = merged(default_values, set_values(values[name]))
        return values


def merged(base: Any, over: Any) -> Any:
    """``base`` overridden by ``over``; mappings are merged key by key.

    ``None`` is a value like any other. Neither argument is changed.
    """
    if not (isinstance(base, Mapping) and isinstance(over, Mapping)):
        return over
    return {**base, **{key: merged(base.get(key), value) for key, value in over.items()}}


def without_none(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options without those that are ``None``, and without sections that are empty then."""
    given = {
        key: without_none(value) if isinstance(value, Mapping) else value for key, value in options.items()
    }
    return {key: value for key, value in given.items() if value is not None and value != {}}


def configs_folder() -> Path:
    """The folder of the settings that come with WebGym."""
    package = Path(__file__).parents[1]
    return package / "configs" if (package / "configs").is_dir() else package.parents[1] / "configs"


@cache
def presets() -> dict[str, Path]:
    """The files of settings that come with WebGym, by their names, such as ``train/tiny`` and ``tiny``.

    Those of ``accelerate`` are another program's.
    """
    folder = configs_folder()
    files = {path: path.relative_to(folder).with_suffix("") for path in sorted(folder.rglob("*.yaml"))}
    ours = {path: known for path, known in files.items() if known.parts[0] != "accelerate"}
    return {name: path for path, known in ours.items() for name in (known.name, str(known))}


_TINY = str(Path(__file__).parents[1] / "study" / "weights")
ModelName: TypeAlias = Annotated[str, AfterValidator(lambda model: _TINY if model == "tiny" else model)]
"""A model's folder, its id on the hub, or ``tiny``, whose weights are part of the package."""


def read_yaml(path: Path, hint: str) -> dict[str, Any]:
    """The settings in a YAML file, as plain data.

    Args:
        path: the file, or the name of one that comes with WebGym (:func:`presets`).
        hint: the error's hint for a file without settings, such as where an example is.

    Raises:
        ConfigError: it cannot be read, is not a YAML mapping, or is not confirmed
            (:mod:`webgym.core.consent`).
    """
    if not path.exists():
        name = str(path.with_suffix("") if path.suffix == ".yaml" else path).removeprefix("configs/")
        path = presets().get(name, path)
    if path.is_char_device():  # which may never end
        raise ConfigError(f"{path} is a device", hint="give a file")
    try:
        data = yaml.safe_load(path.read_text("utf-8")) or {}
    except OSError as error:
        ours = ", ".join(name for name in presets() if "/" not in name)
        raise ConfigError(f"cannot read {path}: {error.strerror}", hint=f"by name: {ours}") from error
    except RecursionError as error:
        raise ConfigError(f"{path} is nested too deeply", hint="settings have a few levels") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict):
        raise ConfigError(f"{path} contains no settings", hint=hint)
    if path.resolve() not in {known.resolve() for known in presets().values()}:
        confirm(data, path)
    return data


def read_files(files: Sequence[Path], hint: str) -> dict[str, Any]:
    """Plain data from YAML files, each overriding those before it. Raises the errors of :func:`read_yaml`."""
    data: dict[str, Any] = {}
    for path in files:
        data = merged(data, read_yaml(path, hint))
    return data


def load_settings(
    model: type[S], files: Sequence[Path], hint: str, overrides: Mapping[str, Any] | None = None
) -> S:
    """Settings from YAML files, each overriding those before it, and from options, which override the files.

    Args:
        model: the settings' class.
        files: in order of increasing precedence; none for the defaults.
        hint: the error's hint for a file without settings, such as where an example is.
        overrides: options, in the structure of the settings; ``None`` values override nothing.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing, unknown or out of range.
    """
    data = merged(read_files(files, hint), without_none(overrides or {}))
    return validated(model, data, ", ".join(map(str, files)) or "options")


def validated(
    model: type[S], data: Any, source: str = "", *, failure: type[WebGymError] = ConfigError, hint: str = ""
) -> S:
    """Plain data as settings.

    Args:
        model: the settings' class.
        data: in the structure of the settings.
        source: origin of the data, such as a file's name; the error's message starts with it.
        failure: the error's class.
        hint: the error's hint: what the user should do.

    Raises:
        WebGymError: of the class ``failure``: a setting is missing, unknown or out of range.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise failure(f"{source}: {first_problem(error, model)}".removeprefix(": "), hint=hint) from error


_PLAIN = {
    "model_type": "Input should be a section of settings (KEY: VALUE)",
    "tuple_type": "Input should be a list",
    "list_type": "Input should be a list",
}
"""What is said in place of pydantic's words for types of Python."""

_LISTED = 12
"""Most keys of a section that a message lists."""


def first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    """A line about what is wrong with settings; for an unknown key, it names the most similar known one.

    An unknown key is reported before a missing one: it is often the same key, misspelt.

    Args:
        error: from the validation.
        model: the settings' class.
    """
    problems = error.errors()
    problem = next(
        (candidate for candidate in problems if candidate["type"] == "extra_forbidden"), problems[0]
    )
    where = ".".join(map(str, problem["loc"]))
    if problem["type"] != "extra_forbidden":
        message = _PLAIN.get(problem["type"], problem["msg"]).removeprefix("Value error, ")
        return f"{where}: {message}" if where else message
    keys = sorted(set(_keys(model)))
    nearest, section = _nearest(where, keys), where.rpartition(".")[0]
    said = f"{where}: there is no such setting"
    if section and (nearest is None or nearest.rpartition(".")[0] != section):
        siblings = [key.rpartition(".")[2] for key in keys if key.rpartition(".")[0] == section]
        if 0 < len(siblings) <= _LISTED:
            said += f"; {section} has {', '.join(siblings)}"
    return said + (f"; did you mean {nearest}?" if nearest else "")


def _nearest(key: str, keys: list[str]) -> str | None:
    """The key in another section, else a similar one of the same section, else of another; or ``None``."""
    section, _, name = key.rpartition(".")
    if same := [known for known in keys if known.rpartition(".")[2] == name]:
        return min(same, key=len)
    siblings = [known for known in keys if known.rpartition(".")[0] == section]
    close = get_close_matches(name, [known.rpartition(".")[2] for known in siblings], n=1)
    if close:
        return f"{section}.{close[0]}" if section else close[0]
    similar = get_close_matches(name, {known.rpartition(".")[2] for known in keys}, n=1, cutoff=0.8)
    matches = [known for known in keys if known.rpartition(".")[2] in similar]
    return min(matches, key=len) if matches else None


def _keys(model: type[BaseModel], section: str = "") -> Iterator[str]:
    """The dotted keys of settings and of their sections."""
    for name, field in model.model_fields.items():
        key = f"{section}.{name}" if section else name
        yield key
        for inner in _models(field.annotation):
            yield from _keys(inner, key)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The settings classes that occur in a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def set_values(value: Any) -> Any:
    """The values that a section sets, as plain data; any other value unchanged."""
    return value.model_dump(exclude_unset=True) if isinstance(value, BaseModel) else value
