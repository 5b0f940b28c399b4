"""Where the GPUs of one machine go, as a value."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Self

_FORM: Final = r"(?P<learner>[1-9]\d*)(\+((?P<servers>\d+)x)?(?P<gpus>\d+)(\+(?P<judge>\d+))?)?"


@dataclass(frozen=True, slots=True)
class Layout:
    """GPUs by purpose, in the order in which they are handed out.

    Attributes:
        learner: GPUs that learn, with a process each.
        servers: policy servers.
        server_gpus: GPUs of each, over which it distributes the weights.
        judge: GPUs of the judge's server.
    """

    learner: int
    servers: int = 0
    server_gpus: int = 1
    judge: int = 0

    @classmethod
    def parse(cls, text: str) -> Self:
        """The layout that is written ``4+3+1``, or ``4+2x2+0`` for two policy servers of two GPUs each.

        Raises:
            ValueError: it is written otherwise.
        """
        found = re.fullmatch(_FORM, text)
        if found is None:
            raise ValueError(
                f"{text!r} is not GPUs that learn, policy servers and GPUs that judge: such as 4+3+1"
            )
        servers, gpus = found["servers"], int(found["gpus"] or 0)
        count, each = (int(servers), gpus) if servers else (gpus, 1)
        return cls(int(found["learner"]), count if each else 0, each or 1, int(found["judge"] or 0))

    def __str__(self) -> str:
        each = f"{self.servers}x{self.server_gpus}" if self.server_gpus > 1 else f"{self.servers}"
        return f"{self.learner}+{each}+{self.judge}"

    @property
    def replying(self) -> range:
        """Places of the policy servers' GPUs among all."""
        return range(self.learner, self.learner + self.servers * self.server_gpus)

    @property
    def judging(self) -> range:
        """Places of the judge's GPUs among all."""
        return range(self.replying.stop, self.total)

    @property
    def total(self) -> int:
        """Number of GPUs."""
        return self.learner + self.servers * self.server_gpus + self.judge
