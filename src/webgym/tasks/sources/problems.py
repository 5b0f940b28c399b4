"""What keeps a record or a file of a source from giving tasks."""

from __future__ import annotations

import msgspec


class PassedOver(msgspec.Struct, frozen=True):
    """A file that was not read as tasks.

    Attributes:
        file: as it was found.
        reason: what it is instead, or what is wrong with it.
    """

    file: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}: {self.reason}"


class Unusable(ValueError):
    """A record gives no task; the message is the reason and quotes nothing."""
