"""How settings of a file, of options and of defaults become one: key by key, never a section for a section.

Whoever sets one key of a section keeps the rest of it, wherever the rest comes from: from the defaults of a
settings class (:class:`Section`), from another file or from options (:func:`merged`), or from what a family
of models is best sampled with (:meth:`webgym.llm.config.Sampling.over`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from webgym.core.errors import ConfigError, WebGymError

S = TypeVar("S", bound=BaseModel)


class Settings(BaseModel):
    """Documented values that do not change; keys that there are not are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Section(Settings):
    """Settings whose parts keep their defaults when some of their keys are set.

    Where the default of a field is itself a section that sets something, or a mapping, a value is laid over
    that default. (Pydantic by itself would take the value in its place.)
    """

    @model_validator(mode="before")
    @classmethod
    def _over_defaults(cls, given: Any) -> Any:
        if not isinstance(given, Mapping):
            return given
        whole = dict(given)
        for name, field in cls.model_fields.items():
            default = field.get_default(call_default_factory=True, validated_data={})
            if name in whole and isinstance(default, BaseModel | Mapping) and (held := _set_in(default)):
                whole[name] = merged(held, _set_in(whole[name]))
        return whole


def merged(held: Any, over: Any) -> Any:
    """What ``held`` says, with what ``over`` says laid over it; mappings are merged key by key.

    ``None`` is a value like any other. Neither is changed.
    """
    if not (isinstance(held, Mapping) and isinstance(over, Mapping)):
        return over
    return {**held, **{key: merged(held.get(key), value) for key, value in over.items()}}


def without_none(options: Mapping[str, Any]) -> dict[str, Any]:
    """What options say, without those that were not given, and without sections that then say nothing."""
    told = {key: without_none(each) if isinstance(each, Mapping) else each for key, each in options.items()}
    return {key: each for key, each in told.items() if each is not None and each != {}}


def read_yaml(path: Path, hint: str) -> dict[str, Any]:
    """The settings in a YAML file, as plain data.

    Args:
        path: of the file.
        hint: where an example is, for a file that contains no settings.

    Raises:
        ConfigError: it cannot be read, or holds something else.
    """
    try:
        held = yaml.safe_load(path.read_text("utf-8")) or {}
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(held, dict):
        raise ConfigError(f"{path} contains no settings", hint=hint)
    return held


def read_files(files: Sequence[Path], hint: str) -> dict[str, Any]:
    """Plain data from YAML files, each laid over those before it. Raises what :func:`read_yaml` does."""
    held: dict[str, Any] = {}
    for path in files:
        held = merged(held, read_yaml(path, hint))
    return held


def load_settings(
    model: type[S], files: Sequence[Path], hint: str, overrides: Mapping[str, Any] | None = None
) -> S:
    """Settings from YAML files, each laid over those before it, and from options, laid over all of them.

    Args:
        model: the settings' class.
        files: in their order; none for the defaults.
        hint: tells the user where an example is.
        overrides: what options say, in the shape of the settings; ``None`` overrides nothing.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing, unknown or out of range.
    """
    held = merged(read_files(files, hint), without_none(overrides or {}))
    return validated(model, held, ", ".join(map(str, files)) or "options")


def validated(
    model: type[S],
    held: Any,
    source: str = "",
    *,
    failure: type[WebGymError] = ConfigError,
    hint: str = "",
) -> S:
    """Plain data as settings.

    Args:
        model: the settings' class.
        held: the data, in its shape.
        source: where the data come from, such as a file's name; the error's message starts with it.
        failure: the error's class.
        hint: what the user should do.

    Raises:
        WebGymError: ``failure``; a setting is missing, unknown or out of range.
    """
    try:
        return model.model_validate(held)
    except ValidationError as error:
        raise failure(f"{source}: {first_problem(error, model)}".removeprefix(": "), hint=hint) from error


def first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    """What is wrong with settings, in one line; of a key that there is not, the nearest one that there is.

    A key that there is not comes before one that is missing: it is often the same one, misspelt.

    Args:
        error: of their validation.
        model: what they were to be.
    """
    problems = error.errors()
    found = next((each for each in problems if each["type"] == "extra_forbidden"), problems[0])
    where = ".".join(map(str, found["loc"]))
    if found["type"] != "extra_forbidden":
        message = found["msg"].removeprefix("Value error, ")
        return f"{where}: {message}" if where else message
    nearest = _nearest(where, sorted(set(_keys(model))))
    return f"{where}: there is no such setting" + (f"; did you mean {nearest}?" if nearest else "")


def _nearest(key: str, keys: list[str]) -> str | None:
    """A key of the same section that is spelt alike, else one of another section that is."""
    section, _, name = key.rpartition(".")
    beside = [each for each in keys if each.rpartition(".")[0] == section]
    close = get_close_matches(name, [each.rpartition(".")[2] for each in beside], n=1)
    if close:
        return f"{section}.{close[0]}" if section else close[0]
    alike = get_close_matches(name, {each.rpartition(".")[2] for each in keys}, n=1, cutoff=0.8)
    named = [each for each in keys if each.rpartition(".")[2] in alike]
    return min(named, key=len) if named else None


def _keys(model: type[BaseModel], section: str = "") -> Iterator[str]:
    """The keys of settings and of their sections, with dots."""
    for name, field in model.model_fields.items():
        key = f"{section}.{name}" if section else name
        yield key
        for inner in _models(field.annotation):
            yield from _keys(inner, key)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The sections that a value of this type may be."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def _set_in(value: Any) -> Any:
    """What a section says, as plain data; anything else as it is."""
    return value.model_dump(exclude_unset=True) if isinstance(value, BaseModel) else value
