"""Which tasks of a set may be drawn: of which split, of which domains, on which websites.

Whoever draws tasks for a policy asks here: the samplers, runs, ``webgym tasks sample``. **By default these
are the training tasks, and nothing else** where a set tells its splits. Nothing that is drawn for training is
on a website of the test split, or of a brand that has one there (:mod:`webgym.tasks.brands`), or of the
family of a test task, whatever the set says. What was left out is counted.
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
from webgym.core.task import Level, Task
from webgym.core.websites import host_or_text
from webgym.settings import Settings
from webgym.tasks.split import leaks
from webgym.tasks.taxonomy import DOMAIN_OF, DOMAINS

BLOCKED: Final = "on blocked websites"
"""Why tasks are left out whose websites kept the agent out lately."""

SplitName: TypeAlias = Literal["train", "test", "all", "unsplit"]


class Selection(Settings):
    """Which tasks, and in which shares."""

    split: SplitName = "train"
    """Split to draw from: ``train``, ``test``, ``all``, or ``unsplit`` for tasks that do not say.

    Of a set that tells no split at all, ``train`` and ``test`` take everything, and the choice is reported as
    ``unsplit``.
    """

    domains: tuple[str, ...] = ()
    """Domains and subdomains to draw from; all if empty."""

    without: tuple[str, ...] = ()
    """Domains and subdomains that are not drawn from."""

    without_share: float = Field(default=0.0, ge=0, lt=1)
    """Share of the subdomains that is not drawn from either, chosen at random by ``without_seed``: the same
    ones whatever the tasks. 0.5 is the paper's run that excludes domains."""

    without_seed: int = 0
    """Of that choice. Not the run's seed: several runs of a study leave the same subdomains out."""

    ratio: dict[Level, float] | None = None
    """Shares of the levels, such as 2:1:1; a level that is not named is not drawn. ``None`` draws from all
    tasks alike. Over many draws the shares are exact to one task."""

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
        tasks: in the order in which they came.
        split: what they are of; ``unsplit`` where ``train`` or ``test`` was asked for and no task says.
        without: the domains and subdomains left out, those that were chosen at random included.
        left_out: how many tasks were left out, by reason.
    """

    tasks: list[Task]
    split: SplitName
    without: tuple[str, ...]
    left_out: Counter[str]

    def told(self) -> str:
        """What was left out, for a person; empty if nothing was."""
        return ", ".join(f"{count:,} {reason}" for reason, count in self.left_out.items())


def select(tasks: Sequence[Task], selection: Selection, blocked: Collection[str] = ()) -> Selected:
    """Choose the tasks that may be drawn.

    Args:
        tasks: the set. Where it holds test tasks, training tasks that would give them away are left out.
        selection: which.
        blocked: hosts that are left alone for now, as :func:`webgym.core.websites.host_of` names them.
            Tasks on them that are, or are asked for as, test tasks stay: a test set is the same set whatever
            happened before.

    Raises:
        ConfigError: there is no such domain.
    """
    split = selection.split
    if split in ("train", "test") and not any(task.split for task in tasks):
        split = "unsplit"
    without = _without(tasks, selection)
    given_away = _given_away(tasks) if split == "train" else set()
    if selection.split == "test":  # also of a set that does not say what it is for
        blocked = ()
    wanted, unwanted = {*selection.domains}, {*without}
    left_out: Counter[str] = Counter()
    kept: list[Task] = []
    for task in tasks:
        names = (task.domain, task.subdomain)
        if split != "all" and (task.split or "unsplit") != split:
            left_out["of the test split" if task.split == "test" else "of another split"] += 1
        elif task.id in given_away:
            left_out["on a website or of a family of the test split"] += 1
        elif (wanted and wanted.isdisjoint(names)) or not unwanted.isdisjoint(names):
            left_out["of other domains"] += 1
        elif blocked and task.split != "test" and host_or_text(task.website) in blocked:
            left_out[BLOCKED] += 1
        else:
            kept.append(task)
    return Selected(kept, split, without, left_out)


def _given_away(tasks: Sequence[Task]) -> set[str]:
    test = [task for task in tasks if task.split == "test"]
    return {leak.task.id for leak in leaks(tasks, test)} if test else set()


def _without(tasks: Sequence[Task], selection: Selection) -> tuple[str, ...]:
    """What is not drawn from, checked and complete."""
    found = {name for task in tasks for name in (task.domain, task.subdomain)}
    if unknown := {*selection.domains, *selection.without}.difference(DOMAINS, DOMAIN_OF, found):
        hint = f"the domains are {', '.join(DOMAINS)}"
        raise ConfigError(f"unknown domain {min(unknown)!r}", hint=hint)
    return tuple(dict.fromkeys([*selection.without, *drawn_subdomains(selection)]))


def drawn_subdomains(selection: Selection) -> list[str]:
    """The subdomains of the taxonomy that ``without_share`` leaves out, sorted."""
    order = sorted(DOMAIN_OF, key=lambda name: _drawn(selection.without_seed, name))
    return sorted(order[: round(selection.without_share * len(order))])


def _drawn(seed: int, name: str) -> bytes:
    return hashlib.blake2b(f"without/{seed}/{name}".encode(), digest_size=8).digest()


def splits_in(tasks: Iterable[Task]) -> str:
    """The splits that these tasks say they are of: ``train``, ``test``, ``unsplit`` or several."""
    return ", ".join(sorted({task.split or "unsplit" for task in tasks}))
