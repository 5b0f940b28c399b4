"""The families of models that are known by name.

A file ``*.toml`` of this folder adds families: a table each, whose name is the profile's and whose keys are
the attributes of :class:`~webgym.agent.profile.Profile`. ``docs/agent.md`` shows a whole one.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

import msgspec

from webgym.agent.profile import Profile
from webgym.core.action import Mode
from webgym.core.errors import ConfigError
from webgym.llm.config import Sampling

FOLDER: Final = Path(__file__).parent

GENERIC = Profile(name="generic")
"""For models that no family knows: nothing is assumed that an endpoint may not understand."""


@cache
def all_profiles(folder: Path = FOLDER) -> dict[str, Profile]:
    """Every profile by its name, :data:`GENERIC` first.

    Raises:
        ValueError: two have the same name, or a file holds something else.
    """
    found = {GENERIC.name: GENERIC}
    for path in sorted(folder.glob("*.toml")):
        for name, family in msgspec.toml.decode(path.read_bytes()).items():
            if name in found:
                raise ValueError(f"there are two profiles {name!r}")
            found[name] = msgspec.convert(
                family | {"name": name}, Profile, dec_hook=lambda _, value: Sampling.model_validate(value)
            )
    return found


def profile_of(model: str) -> Profile | None:
    """The profile of the family that a model's name belongs to; ``None`` if no family knows it."""
    return next((profile for profile in all_profiles().values() if profile.fits(model)), None)


def choose_profile(name: str | None, model: str, mode: Mode | None = None) -> Profile:
    """The profile to use.

    Args:
        name: of a profile; ``None`` goes by the model's name, and is :data:`GENERIC` if no family knows it.
        model: the model's name.
        mode: in place of the profile's own.

    Raises:
        ConfigError: there is no profile of this name.
    """
    if name is None:
        chosen = profile_of(model) or GENERIC
    elif (named := all_profiles().get(name)) is not None:
        chosen = named
    else:
        hint = f"choose one of {', '.join(all_profiles())}"
        raise ConfigError(f"unknown profile {name!r}", hint=hint)
    return chosen if mode is None else msgspec.structs.replace(chosen, mode=mode)
