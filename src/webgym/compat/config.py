"""Settings of the compatibility layer: its limits, with their units and reasons."""

from __future__ import annotations

from pydantic import Field

from webgym.core.settings import Settings


class CompatConfig(Settings):
    """Lifetimes and limits of instances."""

    lifetime_minutes: float = Field(default=60.0, gt=0)
    """Lifetime of an instance whose ``lifetime_mins`` is missing or 0."""

    longest_minutes: float = Field(default=240.0, gt=0)
    """Longest lifetime that a client may request. A session does not last longer either."""

    reset_idle_seconds: float = Field(default=600.0, gt=0)
    """Idle time after which an instance ends that was used again after its reset: the authors' clients
    release an instance with ``/reset``, and a late call must not keep a browser for the rest of its
    lifetime. Longer than a model thinks."""

    instances: int = Field(default=10_000, gt=0)
    """Largest number of instances, including those without a browser, of which the oldest are dropped
    first."""

    waiting: int = Field(default=1024, gt=0)
    """Most callers of ``/get`` that wait for a slot at once."""

    sleep_seconds: float = Field(default=60.0, gt=0)
    """The longest ``sleep`` that is carried out; longer ones are shortened to it."""
