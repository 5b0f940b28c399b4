"""Selects one task from each of many websites, balanced over levels and domains.

A website offers tasks of one or several (level, domain) pairs, and gives at most one task. This is an
assignment problem. It is solved by augmenting paths: websites are added one by one to the pair with the
fewest tasks, reassigning earlier websites to other pairs where that makes room; then tasks are exchanged
between pairs as long as that improves the balance.
"""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict, deque
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

Pair: TypeAlias = tuple[str, str]
"""Level and domain."""


def balanced(offers: Sequence[Sequence[Pair]], count: int) -> dict[int, Pair]:
    """Choose ``count`` websites and, for each, one of the pairs that it offers.

    Levels are balanced first, then domains, then pairs: in this order, the sum of squares of their counts
    cannot be lowered by replacing one task by a task of another pair. This is optimal except in rare cases of
    few websites, in which only two such replacements together would help.

    Args:
        offers: the pairs that each website offers: at least one, without duplicates. Earlier websites are
            preferred.
        count: at most the number of websites.

    Returns:
        The pair chosen for each chosen website, by its index in ``offers``.
    """
    table = _Table(offers)
    for _ in range(count):
        table.add()
    while table.exchange():
        pass
    return table.chosen


class _Table:
    """The assignment of websites to pairs. In paths, ``None`` stands for the unassigned websites."""

    def __init__(self, offers: Sequence[Sequence[Pair]]) -> None:
        self.chosen: dict[int, Pair] = {}
        self._offers = offers
        self._free: dict[Pair, list[int]] = defaultdict(list)
        for website, pairs in enumerate(offers):
            for pair in pairs:
                self._free[pair].append(website)  # ascending, so a heap already
        self._pairs = sorted(self._free)
        self._extendable = list(self._pairs)
        self._members: dict[Pair, set[int]] = {pair: set() for pair in self._pairs}
        self._movable: dict[Pair, Counter[Pair]] = {pair: Counter() for pair in self._pairs}
        self._levels: Counter[str] = Counter()
        self._domains: Counter[str] = Counter()

    def add(self) -> None:
        """Assign one more website, to the pair with the fewest tasks among those that can have another."""
        for pair in sorted(self._extendable, key=self._weight):
            path = self._path(None, pair)
            if path:
                self._apply(path)
                return
            self._extendable.remove(pair)  # no website that is added later can make room here

    def exchange(self) -> bool:
        """Replace a task of one pair by a task of another, if that improves the balance; whether it did."""
        best, exchanged = (0, 0, 0), None
        for fuller in self._pairs:
            if not self._members[fuller]:
                continue
            reached = self._reachable(fuller)
            for emptier in self._pairs:
                gain = self._gain(fuller, emptier)
                if emptier != fuller and gain < best and emptier in reached:
                    best, exchanged = gain, (fuller, emptier)
        if exchanged is None:
            return False
        self._apply(self._path(*exchanged))
        return True

    def _weight(self, pair: Pair) -> tuple[int, int, int, Pair]:
        level, domain = pair
        return self._levels[level], self._domains[domain], len(self._members[pair]), pair

    def _gain(self, fuller: Pair, emptier: Pair) -> tuple[int, int, int]:
        """Half of the change of the sums of squares of levels, domains and pairs; negative is better."""
        level = domain = 0
        if fuller[0] != emptier[0]:
            level = self._levels[emptier[0]] - self._levels[fuller[0]] + 1
        if fuller[1] != emptier[1]:
            domain = self._domains[emptier[1]] - self._domains[fuller[1]] + 1
        return level, domain, len(self._members[emptier]) - len(self._members[fuller]) + 1

    def _reachable(self, start: Pair | None) -> dict[Pair | None, Pair | None]:
        """The pairs that can get another website if ``start`` gives one up, each with its predecessor on the
        path."""
        predecessors: dict[Pair | None, Pair | None] = {start: start}
        queue = deque([start])
        while queue:
            current = queue.popleft()
            for pair in self._pairs:
                if pair not in predecessors and (
                    self._first_free(pair) if current is None else self._movable[current][pair]
                ):
                    predecessors[pair] = current
                    queue.append(pair)
            if None not in predecessors:
                predecessors[None] = current
                queue.append(None)
        return predecessors

    def _path(self, start: Pair | None, end: Pair) -> list[Pair | None]:
        if start is None and self._first_free(end):
            return [None, end]
        predecessors = self._reachable(start)
        if end not in predecessors:
            return []
        path: list[Pair | None] = [end]
        while path[-1] != start:
            path.append(predecessors[path[-1]])
        return path[::-1]

    def _first_free(self, pair: Pair) -> list[int]:
        """Heap of the unassigned websites that offer a pair, the preferred one first; empty if there is
        none."""
        heap = self._free[pair]
        while heap and heap[0] in self.chosen:
            heapq.heappop(heap)
        return heap

    def _apply(self, path: list[Pair | None]) -> None:
        """Move one website along every edge of the path. All are chosen before the first is moved."""
        moves: list[tuple[int, Pair | None]] = []
        for current, pair in pairwise(path):
            if current is None:
                assert pair is not None
                moves.append((self._first_free(pair)[0], pair))
            elif pair is None:
                moves.append((max(self._members[current]), None))
            else:
                movable = (website for website in self._members[current] if pair in self._offers[website])
                moves.append((min(movable), pair))
        for website, pair in moves:
            self._move(website, pair)

    def _move(self, website: int, target: Pair | None) -> None:
        old = self.chosen.pop(website, None)
        if old is not None:
            self._count(website, old, -1)
            self._members[old].remove(website)
        if target is not None:
            self.chosen[website] = target
            self._members[target].add(website)
            self._count(website, target, 1)
        else:
            for pair in self._offers[website]:
                heapq.heappush(self._free[pair], website)

    def _count(self, website: int, pair: Pair, change: int) -> None:
        self._levels[pair[0]] += change
        self._domains[pair[1]] += change
        for other in self._offers[website]:
            if other != pair:
                self._movable[pair][other] += change
