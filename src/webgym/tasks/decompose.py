"""Easier tasks out of harder ones (paper Algorithm 1). No rollout and no model is needed for it.

A task whose rubric has two groups or more, one of them large, gives one task for every proper subset of the
groups that holds a large one. What it asks for is its subset; its instruction is still its parent's until it
has been rewritten.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import msgspec
from pydantic import Field

from webgym.core.task import FactGroup, Rubric, Task
from webgym.settings import Settings
from webgym.tasks.published import DIFFICULTY_DIFFERS

SYNTHETIC: Final = ("pae-webvoyager", "agentsynth-web")
"""Sources that a model wrote. Deriving more from them fills the set with what looks alike (paper §3)."""


class DecompositionLimits(Settings):
    """How many tasks may come out of one."""

    per_parent: int = Field(default=1_024, ge=0)
    """The subsets of g groups are 2^g. Ten groups, more than any source's task has, stay below this."""
    per_synthetic_parent: int = Field(default=1, ge=0)
    """The same for a task of the sources in ``synthetic``."""
    synthetic: tuple[str, ...] = SYNTHETIC
    """Sources whose tasks a model made up."""

    def at_most(self, task: Task) -> int:
        """The number of tasks that this one may give."""
        return self.per_synthetic_parent if task.source in self.synthetic else self.per_parent


@dataclass(frozen=True, slots=True)
class Capped:
    """A task that would give more than it may.

    Attributes:
        id: of the task.
        possible: subsets that Algorithm 1 would take.
        taken: how many were.
    """

    id: str
    possible: int
    taken: int


@dataclass(frozen=True, slots=True)
class Decomposition:
    """What a list of tasks gave: the derived tasks, and the parents whose number was capped."""

    derived: list[Task]
    capped: list[Capped]


def possible(rubric: Rubric) -> int:
    """How many tasks can be derived from one with this rubric, without making them: 2^g - 2^s - 1.

    All subsets, less those of the s small groups alone, less the whole.
    """
    groups = len(rubric.groups)
    small = sum(not group.is_large for group in rubric.groups)
    return 0 if groups < 2 or small == groups else (1 << groups) - (1 << small) - 1


def derive(task: Task, limits: DecompositionLimits | None = None) -> list[Task]:
    """The tasks that can be derived from this one, fewest groups first. None from a derived one.

    A derived task's id is ``<parent>+<group ids>``, ascending, so it is the same in whatever order the groups
    come. It inherits website, domain, source, split and flags; not what is about the whole task: the answers,
    the hidden truth, foreign columns, and the flag of a difficulty that is not the number of facts.

    Where there are more than the limits allow, a choice of subsets is taken that depends on the task's id and
    its groups' ids alone.
    """
    if task.parent_id is not None:
        return []
    count = possible(task.rubric)
    at_most = (limits or _USUAL).at_most(task)
    if not count or not at_most:
        return []
    groups = tuple(sorted(task.rubric.groups, key=lambda group: group.id))
    if count <= at_most:
        return [_derived(task, rubric) for rubric in Rubric(groups).decompositions()]
    return [_derived(task, Rubric(chosen)) for chosen in _some(groups, at_most, task.id)]


def decompose(tasks: Iterable[Task], limits: DecompositionLimits | None = None) -> Decomposition:
    """:func:`derive` over many tasks, with a note of every parent that a limit held back."""
    limits = limits or _USUAL
    derived: list[Task] = []
    capped: list[Capped] = []
    for task in tasks:
        if len(task.rubric.groups) < 2 or task.parent_id is not None:
            continue
        children = derive(task, limits)
        derived += children
        if (count := possible(task.rubric)) > len(children):
            capped.append(Capped(task.id, count, len(children)))
    return Decomposition(derived, capped)


_USUAL: Final = DecompositionLimits()


def _derived(task: Task, rubric: Rubric) -> Task:
    return msgspec.structs.replace(
        task,
        id=f"{task.id}+{'-'.join(str(group.id) for group in rubric.groups)}",
        rubric=rubric,
        parent_id=task.id,
        flags=tuple(flag for flag in task.flags if flag != DIFFICULTY_DIFFERS),
        reference_answer=None,
        example_answer=None,
        extra={},
        truth=None,
    )


def _some(groups: tuple[FactGroup, ...], count: int, name: str) -> list[tuple[FactGroup, ...]]:
    """That many of the subsets that may be taken, which are more, drawn evenly."""
    rng = random.Random(f"decompose/{name}/{[group.id for group in groups]}")
    whole = (1 << len(groups)) - 1
    large = sum(1 << index for index, group in enumerate(groups) if group.is_large)
    chosen: set[int] = set()
    while len(chosen) < count:
        mask = rng.getrandbits(len(groups))
        if mask & large and mask != whole:
            chosen.add(mask)
    subsets = [tuple(group for index, group in enumerate(groups) if mask >> index & 1) for mask in chosen]
    return sorted(subsets, key=lambda subset: (len(subset), [group.id for group in subset]))
