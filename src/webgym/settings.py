"""How settings of a file, of options and of defaults become one: key by key, never a section for a section.

Whoever sets one key of a section keeps the rest of it, wherever the rest comes from: from the defaults of a
settings class (:class:`Section`), from another file or from options (:func:`merged`), or from what a family
of models is best sampled with (:meth:`webgym.llm.config.Sampling.over`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, model_validator

from webgym.core.errors import ConfigError


class Section(BaseModel):
    """Settings whose parts keep their defaults when some of their keys are set.

    Where the default of a field is itself a section that sets something, or a mapping, a value is laid over
    that default. (Pydantic by itself would take the value in its place.)
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

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


def read_settings(path: Path, hint: str) -> dict[str, Any]:
    """The settings in a YAML file, as plain data.

    Args:
        path: of the file.
        hint: where an example is, for a file that holds no settings.

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
        raise ConfigError(f"{path} holds no settings", hint=hint)
    return held


def _set_in(value: Any) -> Any:
    """What a section says, as plain data; anything else as it is."""
    return value.model_dump(exclude_unset=True) if isinstance(value, BaseModel) else value
