"""Settings of the offline web."""

from __future__ import annotations

from typing import Literal, TypeAlias

from pydantic import Field, SecretStr

from webgym.offline.latency import SIGMA
from webgym.settings import Settings

DEFAULT_SEED = 7

CollectionName: TypeAlias = Literal["large", "small", "cross"]


class SitesConfig(Settings):
    """How the offline web is served."""

    seed: int = DEFAULT_SEED
    """Of every website."""

    collection: CollectionName = "large"
    """Which websites: ``large``, as on the real web, or ``small``, pages of a few large signs."""

    per_family: int | None = Field(default=None, ge=1)
    """Websites in every family; ``None`` for the collection's own number (50 large and cross, 72 small)."""

    host: str = "127.0.0.1"
    """Address to listen on; loopback unless asked otherwise."""

    port: int = Field(default=0, ge=0, le=65535)
    """Port to listen on; 0 takes a free one."""

    latency: float = Field(default=1.0, ge=0, le=100)
    """Scale of the simulated latency; 0 turns it off."""

    latency_sigma: float = Field(default=SIGMA, ge=0, le=3)
    """Spread of its logarithm."""

    slow_seconds: float = Field(default=4.0, ge=0)
    """What every page of a slow website takes."""

    token: SecretStr | None = None
    """For the administration; random if not given."""

    keep_alive_seconds: int = Field(default=75, gt=0)
    """Idle connections are kept for longer than clients keep them, so that none closes as it is used."""

    start_seconds: float = Field(default=30.0, gt=0)
    """How long the server may take to start."""
