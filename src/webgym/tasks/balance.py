"""Selects one task from each of many websites, balanced over levels and domains.

A website offers tasks of one or several (level, domain) pairs, and gives one task at most. That is an
assignment problem. It is solved by adding one website after the other where it is needed most, moving earlier
ones to another of their pairs where that makes room, and then by exchanges for as long as one helps.
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

    Levels are made even first, then domains, then pairs: in this order, the sums of the squares of their
    counts cannot be lowered by one task of some pair less and one of another more. That is the optimum but
    for rare cases of few websites, in which two such exchanges help where neither does alone.

    Args:
        offers: per website, at least one pair and none twice. Earlier websites are preferred.
        count: at most the number of websites.

    Returns:
        The pair chosen for each website, by its place in ``offers``.
    """
    table = _Table(offers)
    for _ in range(count):
        table.add()
    while table.exchange():
        pass
    return table.chosen


class _Table:
    """Which website stands for which pair; ``None`` is the place of those that stand for none."""

    def __init__(self, offers: Sequence[Sequence[Pair]]) -> None:
        self.chosen: dict[int, Pair] = {}
        self._offers = offers
        self._free: dict[Pair, list[int]] = defaultdict(list)
        for website, pairs in enumerate(offers):
            for pair in pairs:
                self._free[pair].append(website)  # ascending, so a heap already
        self._pairs = sorted(self._free)
        self._open = list(self._pairs)
        self._at: dict[Pair, set[int]] = {pair: set() for pair in self._pairs}
        self._ways: dict[Pair, Counter[Pair]] = {pair: Counter() for pair in self._pairs}
        self._levels: Counter[str] = Counter()
        self._domains: Counter[str] = Counter()

    def add(self) -> None:
        """Give one more website to the pair that needs it most among those that can have one."""
        for pair in sorted(self._open, key=self._weight):
            path = self._path(None, pair)
            if path:
                self._walk(path)
                return
            self._open.remove(pair)  # no later website will make room here

    def exchange(self) -> bool:
        """Take one task of a pair away and add one to another, if that makes the whole more even."""
        best, end = (0, 0, 0), None
        for fuller in self._pairs:
            if not self._at[fuller]:
                continue
            reached = self._reach(fuller)
            for emptier in self._pairs:
                gain = self._gain(fuller, emptier)
                if emptier != fuller and gain < best and emptier in reached:
                    best, end = gain, (fuller, emptier)
        if end is None:
            return False
        self._walk(self._path(*end))
        return True

    def _weight(self, pair: Pair) -> tuple[int, int, int, Pair]:
        level, domain = pair
        return self._levels[level], self._domains[domain], len(self._at[pair]), pair

    def _gain(self, fuller: Pair, emptier: Pair) -> tuple[int, int, int]:
        """Half of the change of the sums of squares; negative is better."""
        level = domain = 0
        if fuller[0] != emptier[0]:
            level = self._levels[emptier[0]] - self._levels[fuller[0]] + 1
        if fuller[1] != emptier[1]:
            domain = self._domains[emptier[1]] - self._domains[fuller[1]] + 1
        return level, domain, len(self._at[emptier]) - len(self._at[fuller]) + 1

    def _reach(self, start: Pair | None) -> dict[Pair | None, Pair | None]:
        """Where a place can be made at the cost of the start, and from where one comes there."""
        came: dict[Pair | None, Pair | None] = {start: start}
        queue = deque([start])
        while queue:
            place = queue.popleft()
            for pair in self._pairs:
                if pair not in came and (
                    self._first_free(pair) if place is None else self._ways[place][pair]
                ):
                    came[pair] = place
                    queue.append(pair)
            if None not in came:
                came[None] = place
                queue.append(None)
        return came

    def _path(self, start: Pair | None, end: Pair) -> list[Pair | None]:
        if start is None and self._first_free(end):
            return [None, end]
        came = self._reach(start)
        if end not in came:
            return []
        path: list[Pair | None] = [end]
        while path[-1] != start:
            path.append(came[path[-1]])
        return path[::-1]

    def _first_free(self, pair: Pair) -> list[int]:
        """The free websites that offer a pair, the preferred one first; empty if there is none."""
        heap = self._free[pair]
        while heap and heap[0] in self.chosen:
            heapq.heappop(heap)
        return heap

    def _walk(self, path: list[Pair | None]) -> None:
        """Move one website along every stretch. Who moves is settled before anyone does."""
        moves: list[tuple[int, Pair | None]] = []
        for place, pair in pairwise(path):
            if place is None:
                assert pair is not None
                moves.append((self._first_free(pair)[0], pair))
            elif pair is None:
                moves.append((max(self._at[place]), None))
            else:
                moves.append((min(one for one in self._at[place] if pair in self._offers[one]), pair))
        for website, pair in moves:
            self._move(website, pair)

    def _move(self, website: int, to: Pair | None) -> None:
        old = self.chosen.pop(website, None)
        if old is not None:
            self._count(website, old, -1)
            self._at[old].remove(website)
        if to is not None:
            self.chosen[website] = to
            self._at[to].add(website)
            self._count(website, to, 1)
        else:
            for pair in self._offers[website]:
                heapq.heappush(self._free[pair], website)

    def _count(self, website: int, pair: Pair, by: int) -> None:
        self._levels[pair[0]] += by
        self._domains[pair[1]] += by
        for other in self._offers[website]:
            if other != pair:
                self._ways[pair][other] += by
