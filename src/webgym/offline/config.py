"""Settings of the offline web."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, TypeAlias

from pydantic import Field, SecretStr

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings
from webgym.offline.latency import LONGEST_SECONDS, SIGMA

DEFAULT_SEED = 7

CollectionName: TypeAlias = Literal["large", "small", "cross"]

TASK_SETS: Final[dict[str, CollectionName]] = {
    "offline-v2": "large",
    "offline-small-v2": "small",
    "offline-cross-v2": "cross",
}
"""Names of the task sets that come with WebGym. A name always has the same websites and tasks."""


def collection_of(name: str) -> CollectionName | None:
    """The collection of a task set that comes with WebGym; ``None`` if the name is a file's, or unknown.

    Raises:
        ConfigError: it names an earlier version of a set.
    """
    if Path(name).exists():
        return None
    for known, collection in TASK_SETS.items():
        if known == name:
            return collection
        if known.rstrip("0123456789") == name.rstrip("0123456789"):
            raise ConfigError(f"there are no tasks named {name!r} any more", hint=f"{known} replaces them")
    return None


class SitesConfig(Settings):
    """Settings of the server of the offline web."""

    seed: int = DEFAULT_SEED
    """Seed of all websites."""

    collection: CollectionName = "large"
    """Which websites: ``large``, as on the real web, or ``small``, with pages of a few large signs."""

    per_family: int | None = Field(default=None, ge=1)
    """Websites per family; ``None`` for the collection's default (50 for large and cross, 72 for small). A
    website has the same split whatever the number."""

    host: str = "127.0.0.1"
    """Address to listen on."""

    port: int = Field(default=0, ge=0, le=65535)
    """Port to listen on; 0 takes a free one."""

    latency: float = Field(default=1.0, ge=0, le=100)
    """Factor of the simulated latency; 0 turns it off."""

    latency_sigma: float = Field(default=SIGMA, ge=0, le=3)
    """Spread of the simulated latency: standard deviation of its logarithm."""

    latency_longest: float = Field(default=LONGEST_SECONDS, gt=0)
    """Longest simulated latency before the factor, seconds."""

    slow_seconds: float = Field(default=4.0, ge=0)
    """Additional time for every page of a slow website."""

    token: SecretStr | None = None
    """Token of the administration API; random if not given."""

    keep_alive_seconds: int = Field(default=75, gt=0)
    """How long idle connections are kept; longer than clients keep them, so that none closes when it is
    used."""
