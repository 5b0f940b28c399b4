"""Selection of the tasks that may be drawn: by split, domain and website.

Samplers, runs and ``webgym tasks sample`` use it. **By default only the training tasks are selected**, if the
set has splits. No task selected for training is on a website of the test split or of the same brand
(:mod:`webgym.tasks.brands`), or in the family of a test task, whatever its split says. Tasks that are left
out are counted by reason.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from pydantic import Field, model_validator

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings
from webgym.core.task import Level, Task
from webgym.core.websites import host_or_text
from webgym.tasks.split import leaking
from webgym.tasks.taxonomy import DOMAIN_OF, DOMAINS

BLOCKED: Final = "on blocked websites"
"""Reason for leaving out tasks whose websites recently blocked the agent."""

_LEAKS: Final = "on a website or of a family of the test split"
_NAMES: Final = "that name a website of the test split"

SplitName: TypeAlias = Literal["train", "test", "all", "unsplit"]


class Selection(Settings):
    """Which tasks are drawn, and in which shares."""

    split: SplitName = "train"
    """Split to draw from: ``train``, ``test``, ``all``, or ``unsplit`` for tasks without a split.

    From a set without any splits, ``train`` and ``test`` select everything, and the choice is reported as
    ``unsplit``.
    """

    domains: tuple[str, ...] = ()
    """Domains and subdomains to draw from; all if empty."""

    without: tuple[str, ...] = ()
    """Domains and subdomains to leave out."""

    without_share: float = Field(default=0.0, ge=0, lt=1)
    """Share of the subdomains to leave out as well, 0 to 1, chosen at random by ``without_seed``
    independently of the tasks. 0.5 is the paper's run that excludes domains."""

    without_seed: int = 0
    """Seed of that choice, separate from the run's, so that several runs of a study leave out the same
    subdomains."""

    ratio: dict[Level, float] | None = None
    """Shares of the levels, such as 2:1:1; a level without a share is not drawn. ``None`` draws from all
    tasks uniformly. The total number of drawn tasks of a level differs from its share by less than one
    task."""

    @model_validator(mode="after")
    def _check(self) -> Selection:
        shares = [1.0] if self.ratio is None else list(self.ratio.values())
        if not all(0 <= share < math.inf for share in shares) or not any(shares):
            raise ValueError("a ratio needs a share above 0, and none below")
        return self


@dataclass(frozen=True, slots=True)
class Selected:
    """The tasks that may be drawn.

    Attributes:
        tasks: in their original order.
        split: the split they are from; ``unsplit`` if ``train`` or ``test`` was requested of a set without
            splits.
        without: the domains and subdomains left out, including those chosen at random.
        left_out: number of tasks left out, by reason.
    """

    tasks: list[Task]
    split: SplitName
    without: tuple[str, ...]
    left_out: Counter[str]

    def told(self) -> str:
        """The numbers of tasks left out, as text; empty if there are none."""
        return ", ".join(f"{count:,} {reason}" for reason, count in self.left_out.items())


def select(tasks: Sequence[Task], selection: Selection, blocked: Collection[str] = ()) -> Selected:
    """Choose the tasks that may be drawn.

    Args:
        tasks: the whole set. Training tasks that leak its test tasks are left out.
        selection: which tasks to select.
        blocked: hosts whose tasks are left out for now, as from :func:`webgym.core.websites.host_of`. Test
            tasks stay, so that a test set is always the same.

    Raises:
        ConfigError: a domain is unknown.
    """
    split = selection.split
    if split in ("train", "test") and not any(task.split for task in tasks):
        split = "unsplit"
    without = _without(tasks, selection)
    leaked = leaking(tasks) if split == "train" else {}
    if selection.split == "test":  # also if the set has no splits
        blocked = ()
    wanted, unwanted = {*selection.domains}, {*without}
    left_out: Counter[str] = Counter()
    remaining: list[Task] = []
    for task in tasks:
        names = (task.domain, task.subdomain)
        if split != "all" and (task.split or "unsplit") != split:
            left_out["of the test split" if task.split == "test" else "of another split"] += 1
        elif (leak := leaked.get(task.id)) is not None:
            left_out[_LEAKS if leak.why != "names a test website" else _NAMES] += 1
        elif (wanted and wanted.isdisjoint(names)) or not unwanted.isdisjoint(names):
            left_out["of other domains"] += 1
        elif blocked and task.split != "test" and host_or_text(task.website) in blocked:
            left_out[BLOCKED] += 1
        else:
            remaining.append(task)
    return Selected(remaining, split, without, left_out)


def _without(tasks: Sequence[Task], selection: Selection) -> tuple[str, ...]:
    """All domains and subdomains to leave out, those chosen at random included; raises for unknown ones."""
    known = {name for task in tasks for name in (task.domain, task.subdomain)}
    if unknown := {*selection.domains, *selection.without}.difference(DOMAINS, DOMAIN_OF, known):
        hint = f"the domains are {', '.join(DOMAINS)}"
        raise ConfigError(f"unknown domain {min(unknown)!r}", hint=hint)
    return tuple(dict.fromkeys([*selection.without, *drawn_subdomains(selection)]))


def drawn_subdomains(selection: Selection) -> list[str]:
    """The subdomains of the taxonomy that ``without_share`` leaves out at random, sorted."""
    order = sorted(DOMAIN_OF, key=lambda name: _order_key(selection.without_seed, name))
    return sorted(order[: round(selection.without_share * len(order))])


def _order_key(seed: int, name: str) -> bytes:
    return hashlib.blake2b(f"without/{seed}/{name}".encode(), digest_size=8).digest()


def splits_in(tasks: Iterable[Task]) -> str:
    """The splits of these tasks, as text: ``train``, ``test``, ``unsplit`` or several."""
    return ", ".join(sorted({task.split or "unsplit" for task in tasks}))
