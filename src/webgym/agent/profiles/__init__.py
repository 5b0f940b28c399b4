"""The families of models that are known by name.

A file of this folder that has ``PROFILES``, a tuple of :class:`~webgym.agent.profile.Profile`, adds families.
Nothing else needs to know of it. ``docs/agent.md`` shows a whole one.
"""

from __future__ import annotations

import importlib
import pkgutil

import msgspec

from webgym.agent.profile import Profile
from webgym.core.action import Mode
from webgym.core.errors import ConfigError

GENERIC = Profile(name="generic")
"""For models that no family knows: nothing is assumed that an endpoint may not understand."""


def all_profiles() -> dict[str, Profile]:
    """Every profile by its name, :data:`GENERIC` first.

    Raises:
        ValueError: two have the same name.
    """
    found = {GENERIC.name: GENERIC}
    for module in sorted(pkgutil.iter_modules(__path__, f"{__name__}."), key=lambda module: module.name):
        for profile in importlib.import_module(module.name).PROFILES:
            if profile.name in found:
                raise ValueError(f"there are two profiles {profile.name!r}")
            found[profile.name] = profile
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
