"""Why a record or a file of a source gives no task."""

from __future__ import annotations

import msgspec


class PassedOver(msgspec.Struct, frozen=True):
    """A file that was not read as tasks.

    Attributes:
        file: path of the file.
        reason: what kind of file it is, or what is wrong with it.
    """

    file: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}: {self.reason}"


class Unusable(ValueError):
    """Raised for a record that gives no task. The message is the reason, without quoting the record."""
