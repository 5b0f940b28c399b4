"""An index for searching hundreds of thousands of tasks interactively; ``tasks show`` and ``view`` use it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from webgym.core.task import Task
from webgym.core.websites import site_or_text

Places: TypeAlias = NDArray[np.intp]

_SUGGESTED_IDS: Final = 5
"""Most ids that are suggested for one that does not exist."""


@dataclass(frozen=True)
class TaskQuery:
    """A query for tasks: all given conditions must hold; an empty string is no condition.

    Attributes:
        domain, subdomain, source, split, level, flag: value of the task, ignoring case.
        website: a host or a URL; matches every task on the same website (:func:`website_key`).
        text: words that must all occur in id, instruction, website, domain or subdomain, ignoring case.
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
"""Fields that tasks are counted by, and selected by their whole value."""


def website_key(website: str) -> str:
    """The registrable domain of a website, for comparison; the text in lower case if it names no website."""
    return site_or_text(website.strip().lower())


class TaskIndex:
    """An index of tasks, for searching and counting.

    It is built on demand: with 300,000 tasks, the first search by text or by website takes about a second,
    all others some milliseconds.

    Args:
        tasks: the tasks, in the order of search results.
    """

    def __init__(self, tasks: Sequence[Task]) -> None:
        self.tasks = tasks

    def find(self, query: TaskQuery) -> list[int]:
        """Indices in :attr:`tasks` of the matching tasks, in order."""
        mask = np.ones(len(self.tasks), dtype=np.bool_)
        for facet in FACETS:
            if value := getattr(query, facet).casefold():
                groups = self._facets[facet]
                mask &= self._mask(groups[known] for known in groups if known.casefold() == value)
        if query.website:
            mask &= self._mask([self._websites.get(website_key(query.website), np.empty(0, np.intp))])
        places: list[int] = np.flatnonzero(mask).tolist()
        texts = self._texts if query.text.strip() else ()
        for word in query.text.lower().split():
            places = [place for place in places if word in texts[place]]
        return places

    def counts(self, facet: str, places: Sequence[int] | None = None) -> dict[str, int]:
        """Number of tasks with each value of a field, the most frequent value first.

        Args:
            facet: the field, one of :data:`FACETS`. A task counts for each of its flags.
            places: indices of the tasks to count; ``None`` counts all.
        """
        groups = {value: indices for value, indices in self._facets[facet].items() if value}
        if places is None:
            counts = {value: len(indices) for value, indices in groups.items()}
        else:
            mask = self._mask([np.array(places, dtype=np.intp)])
            counts = {value: int(np.count_nonzero(mask[indices])) for value, indices in groups.items()}
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    @property
    def websites(self) -> int:
        """Number of websites."""
        return len(self._websites)

    def get(self, task_id: str) -> Task | None:
        """The task with this id; ``None`` if there is none."""
        place = self._places.get(task_id)
        return None if place is None else self.tasks[place]

    def children(self, task_id: str) -> list[Task]:
        """The tasks derived from this task, in order."""
        return [self.tasks[place] for place in self._children.get(task_id, ())]

    def close_ids(self, task_id: str) -> list[str]:
        """Some ids that contain the given text, as suggestions."""
        folded = task_id.lower()
        return [known for known in self._places if folded in known.lower()][:_SUGGESTED_IDS]

    # --- lookup tables ----------------------------------------------------------------------------

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
        values_of: dict[str, Callable[[Task], Iterable[str]]] = {
            "split": lambda task: (task.split or "",),
            "level": lambda task: (task.level,),
            "domain": lambda task: (task.domain,),
            "subdomain": lambda task: (task.subdomain,),
            "source": lambda task: (task.source,),
            "flag": lambda task: task.flags,
        }
        return {facet: self._grouped(values) for facet, values in values_of.items()}

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
        children: defaultdict[str, list[int]] = defaultdict(list)
        for place, task in enumerate(self.tasks):
            if task.parent_id is not None:
                children[task.parent_id].append(place)
        return dict(children)
