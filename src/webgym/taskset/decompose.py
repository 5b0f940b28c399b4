"""Derives easier tasks from harder ones (paper Algorithm 1), without rollouts and without a model.

A task whose rubric has at least two groups, one of them large, gives one derived task for every proper subset
of the groups that contains a large one. The rubric of the derived task is that subset; its instruction is
still its parent's until it has been rewritten.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import msgspec
from pydantic import Field

from webgym.core.settings import Settings
from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.published import DIFFICULTY_DIFFERS

SYNTHETIC: Final = ("pae-webvoyager", "agentsynth-web")
"""Sources written by a model. Many tasks derived from them would fill the set with similar ones (paper
§3)."""


class DecompositionLimits(Settings):
    """Limits on the number of tasks derived from one task."""

    per_parent: int = Field(default=1_024, ge=0)
    """Most tasks derived from one task. g groups have 2^g subsets; ten groups, more than tasks of the sources
    have, stay below the default."""
    per_synthetic_parent: int = Field(default=1, ge=0)
    """Most tasks derived from one task of a source in ``synthetic``."""
    synthetic: tuple[str, ...] = SYNTHETIC
    """Sources whose tasks were written by a model."""

    def at_most(self, task: Task) -> int:
        """Most tasks that may be derived from this one."""
        return self.per_synthetic_parent if task.source in self.synthetic else self.per_parent


@dataclass(frozen=True, slots=True)
class Decomposition:
    """The tasks derived from a list of tasks, and the number of parents that a limit applied to."""

    derived: list[Task]
    capped: int


def possible(rubric: Rubric) -> int:
    """The number of tasks that can be derived from a task with this rubric: 2^g - 2^s - 1.

    These are all subsets of its g groups, minus those of its s small groups only, minus the whole.
    """
    groups = len(rubric.groups)
    small = sum(not group.is_large for group in rubric.groups)
    return 0 if groups < 2 or small == groups else (1 << groups) - (1 << small) - 1


def derive(task: Task, limits: DecompositionLimits | None = None) -> list[Task]:
    """The tasks derived from this one, those with the fewest groups first; empty for a derived task.

    A derived task's id is ``<parent>+<group ids>``, ascending, so it does not depend on the order of the
    groups. It inherits website, domain, source, split and flags, but nothing that concerns the whole task:
    the answers, the hidden truth, extra columns, and the flag
    :data:`~webgym.tasks.published.DIFFICULTY_DIFFERS`.

    If there are more than the limits allow, a random selection of subsets is taken that depends only on the
    ids of the task and its groups.
    """
    if task.parent_id is not None:
        return []
    count = possible(task.rubric)
    at_most = (limits or _DEFAULT_LIMITS).at_most(task)
    if not count or not at_most:
        return []
    groups = tuple(sorted(task.rubric.groups, key=lambda group: group.id))
    if count <= at_most:
        return [_derived(task, rubric) for rubric in Rubric(groups).decompositions()]
    return [_derived(task, Rubric(chosen)) for chosen in _sampled_subsets(groups, at_most, task.id)]


def decompose(tasks: Iterable[Task], limits: DecompositionLimits | None = None) -> Decomposition:
    """:func:`derive` for many tasks; also counts the parents that a limit applied to."""
    limits = limits or _DEFAULT_LIMITS
    derived: list[Task] = []
    capped = 0
    for task in tasks:
        if len(task.rubric.groups) < 2 or task.parent_id is not None:
            continue
        children = derive(task, limits)
        derived += children
        capped += possible(task.rubric) > len(children)
    return Decomposition(derived, capped)


_DEFAULT_LIMITS: Final = DecompositionLimits()


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


def _sampled_subsets(groups: tuple[FactGroup, ...], count: int, name: str) -> list[tuple[FactGroup, ...]]:
    """``count`` of the subsets that Algorithm 1 takes, sampled uniformly; there must be more of them."""
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
