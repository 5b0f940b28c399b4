"""Every limit of the compatibility layer, with its unit and its reason."""

from __future__ import annotations

from pydantic import Field

from webgym.settings import Settings


class CompatConfig(Settings):
    """How long instances live, and how many are remembered."""

    lifetime_minutes: float = Field(default=60.0, gt=0)
    """Of an instance whose ``lifetime_mins`` is left out or 0."""

    longest_minutes: float = Field(default=240.0, gt=0)
    """The most that a client may ask for. A session does not live longer either."""

    reset_idle_seconds: float = Field(default=600.0, gt=0)
    """An instance that is used again after its reset, and then for so long no more, is taken back: their
    clients let go of an instance with ``/reset``, and a straggler's call must not hold a browser for the
    rest of its lifetime. Longer than a model thinks."""

    instances: int = Field(default=10_000, gt=0)
    """Instances that are remembered at once, those without a browser included; the oldest of those are
    forgotten first."""

    waiting: int = Field(default=1024, gt=0)
    """Callers of ``/get`` that stand in the server's line at once."""

    sleep_seconds: float = Field(default=60.0, gt=0)
    """The longest ``sleep`` that is carried out; longer ones are cut to it."""
