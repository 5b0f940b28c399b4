"""Finding tasks among hundreds of thousands, quick enough to type along: what ``show`` and ``view`` use."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from webgym.core.task import Task
from webgym.core.websites import site_of

Places: TypeAlias = NDArray[np.intp]

_CLOSE: Final = 5
"""Ids to name when there is none of the one asked for."""


@dataclass(frozen=True)
class TaskQuery:
    """Which tasks: all that is given must hold; an empty string asks for nothing.

    Attributes:
        domain, subdomain, source, split, level, flag: as the task has it, whatever the case.
        website: a host or a URL; every task on the same website fits (:func:`site_of`).
        text: words that must all stand somewhere in id, instruction, website or domain, whatever the case.
    """

    domain: str = ""
    subdomain: str = ""
    level: str = ""
    website: str = ""
    source: str = ""
    split: str = ""
    flag: str = ""
    text: str = ""


FACETS: Final[tuple[str, ...]] = ("split", "level", "domain", "subdomain", "source", "flag")
"""What tasks are counted by, and chosen by its whole value."""


def website_key(website: str) -> str:
    """The website to compare by; what is given, in lower case, where it names none."""
    try:
        return site_of(website)
    except ValueError:
        return website.strip().lower()


class TaskIndex:
    """Tasks, and ways to find some of them.

    Built as it is used: the first search by text or by website takes a second or so for 300,000 tasks, any
    other some milliseconds.

    Args:
        tasks: in the order in which they will be found.
    """

    def __init__(self, tasks: Sequence[Task]) -> None:
        self.tasks = tasks

    def find(self, wanted: TaskQuery) -> list[int]:
        """Places of the tasks that fit, in order."""
        mask = np.ones(len(self.tasks), dtype=np.bool_)
        for facet in FACETS:
            if value := getattr(wanted, facet).casefold():
                groups = self._facets[facet]
                mask &= self._mask(groups[known] for known in groups if known.casefold() == value)
        if wanted.website:
            mask &= self._mask([self._websites.get(website_key(wanted.website), np.empty(0, np.intp))])
        places: list[int] = np.flatnonzero(mask).tolist()
        texts = self._texts if wanted.text.strip() else ()
        for word in wanted.text.lower().split():
            places = [place for place in places if word in texts[place]]
        return places

    def counts(self, facet: str, places: Sequence[int] | None = None) -> dict[str, int]:
        """How many tasks have each value of one of :data:`FACETS`, the most frequent value first.

        Args:
            facet: what to count by.
            places: of the tasks to count; all if not given. A task counts for each of its flags.
        """
        groups = {value: having for value, having in self._facets[facet].items() if value}
        if places is None:
            found = {value: len(having) for value, having in groups.items()}
        else:
            mask = self._mask([np.array(places, dtype=np.intp)])
            found = {value: int(np.count_nonzero(mask[having])) for value, having in groups.items()}
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    @property
    def websites(self) -> int:
        """How many there are."""
        return len(self._websites)

    def get(self, task_id: str) -> Task | None:
        """The task of this id."""
        place = self._places.get(task_id)
        return None if place is None else self.tasks[place]

    def children(self, task_id: str) -> list[Task]:
        """The tasks that were derived from one, in order."""
        return [self.tasks[place] for place in self._children.get(task_id, ())]

    def close_ids(self, task_id: str) -> list[str]:
        """Ids that hold the one given, for somebody who knows half of it."""
        folded = task_id.lower()
        return [known for known in self._places if folded in known.lower()][:_CLOSE]

    # --- what is looked up ----------------------------------------------------------------------------

    def _mask(self, groups: Iterable[Places]) -> NDArray[np.bool_]:
        mask = np.zeros(len(self.tasks), dtype=np.bool_)
        for places in groups:
            mask[places] = True
        return mask

    def _grouped(self, values: Callable[[Task], Iterable[str]]) -> dict[str, Places]:
        groups: defaultdict[str, list[int]] = defaultdict(list)
        for place, task in enumerate(self.tasks):
            for value in values(task):
                groups[value].append(place)
        return {value: np.array(places, dtype=np.intp) for value, places in groups.items()}

    @cached_property
    def _facets(self) -> Mapping[str, Mapping[str, Places]]:
        told: dict[str, Callable[[Task], Iterable[str]]] = {
            "split": lambda task: (task.split or "",),
            "level": lambda task: (task.level,),
            "domain": lambda task: (task.domain,),
            "subdomain": lambda task: (task.subdomain,),
            "source": lambda task: (task.source,),
            "flag": lambda task: task.flags,
        }
        return {facet: self._grouped(values) for facet, values in told.items()}

    @cached_property
    def _websites(self) -> Mapping[str, Places]:
        key = cache(website_key)
        return self._grouped(lambda task: (key(task.website),))

    @cached_property
    def _texts(self) -> list[str]:
        return [
            f"{task.id}\n{task.instruction}\n{task.website}\n{task.domain}\n{task.subdomain}".lower()
            for task in self.tasks
        ]

    @cached_property
    def _places(self) -> dict[str, int]:
        return {task.id: place for place, task in enumerate(self.tasks)}

    @cached_property
    def _children(self) -> Mapping[str, list[int]]:
        found: defaultdict[str, list[int]] = defaultdict(list)
        for place, task in enumerate(self.tasks):
            if task.parent_id is not None:
                found[task.parent_id].append(place)
        return dict(found)
