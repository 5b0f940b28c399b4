"""The same task twice, within a source and across sources (SOURCES.md, pitfall 5).

Two tasks can only repeat each other on one website (:func:`webgym.core.websites.site_of`; where it is not
known yet, that is one of its own). There, they are

* **the same** if nothing but case, punctuation, white space and Unicode's forms tells their texts apart;
* **near** if, leaving out little words and the website's own name, their words and pairs of neighbouring
  words overlap by :attr:`DuplicateLimits.similarity` (Jaccard), and both have the same numbers and the same
  names in the same order. A number or a name that differs makes another task, however long the text around
  it: a template filled twice is two tasks. "Paris to Rome" is not "Rome to Paris".

Parents and what was derived from them are near by nature, so members of a family can only be *the same*.
Near texts are found by prefix filtering (Bayardo et al., 2007): two that overlap so much must share one of
their few rarest words or pairs. That is exact but for the bound on how many texts one is compared with.
"""

from __future__ import annotations

import hashlib
import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Generic, Literal, TypeAlias, TypeVar

from pydantic import Field

from webgym.core.task import Task
from webgym.core.websites import site_or_text
from webgym.settings import Settings
from webgym.tasks.decompose import SYNTHETIC
from webgym.tasks.families import roots_of
from webgym.tasks.files import collector_paused
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.texts import LITTLE, fold, joined, names, number, template

AnyTask = TypeVar("AnyTask", Task, SourceTask)
Why: TypeAlias = Literal["same", "near", "parent", "template", "website"]
_Finding: TypeAlias = tuple[str, Why]


class DuplicateLimits(Settings):
    """What repeats what, which one stays, and how much a synthetic source may bring."""

    similarity: float = Field(default=0.85, ge=0.5, le=1.0)
    """Overlap of words and pairs of words from which two tasks are near. At the usual value an added word
    needs a dozen others around it, an exchanged one about twenty."""
    compared: int = Field(default=100, ge=1)
    """Texts that one is compared with, at most, the ones that share its rarest words first."""
    sources: tuple[str, ...] = (
        "online-mind2web",
        "mind2web-2",
        "mind2web-live",
        "deepshop",
        "gaia-web",
        "browsecomp",
        "travelplanner",
        "webgym",
        "insta-v3",
        "agentsynth-web",
        "pae-webvoyager",
    )
    """Whose task stays when two repeat each other: people's before models', then the smaller benchmark's.
    A source that is not named comes before them all. Within a source the smaller id stays."""
    synthetic: tuple[str, ...] = SYNTHETIC
    """The sources that the following limits are for, counted without derived tasks. Which of their tasks come
    first is drawn."""
    per_template: int = Field(default=20, ge=1)
    """Tasks of a website whose texts differ in nothing but numbers."""
    per_website: int = Field(default=12_000, ge=1)
    """Tasks of a website. PAE-WebVoyager has 128,499 on 13, about 9,900 each (paper Table 1)."""
    seed: int = 0
    """Of the draw."""


@dataclass(frozen=True, slots=True)
class DuplicateTask:
    """A task that is not kept.

    Attributes:
        id, source: of the task.
        of: id of the kept task that it repeats or whose template it fills; of its parent where that was
            dropped; empty where its website has too many.
        why: "same" text, "near" text, dropped "parent", too many of a "template" or on a "website".
    """

    id: str
    source: str
    of: str
    why: Why


@dataclass(frozen=True, slots=True)
class Deduplicated(Generic[AnyTask]):
    """The tasks that stay and those that do not, both in the order in which they came."""

    kept: list[AnyTask]
    dropped: list[DuplicateTask]


@collector_paused()  # millions of small things, and no cycle among them
def drop_duplicates(tasks: Sequence[AnyTask], limits: DuplicateLimits | None = None) -> Deduplicated[AnyTask]:
    """Keep one task of those that repeat each other, and cap the synthetic sources.

    Tasks of a source go before derived ones, so a derived task never takes the place of a source's. With a
    parent go its children. Which tasks stay depends on the set of tasks, not on their order.

    Args:
        tasks: with unique ids.
    """
    limits = limits or DuplicateLimits()
    parents = {task.id: task.parent_id for task in tasks if isinstance(task, Task) and task.parent_id}
    roots = roots_of(task for task in tasks if isinstance(task, Task))
    texts = [_Text(task, roots.get(task.id, task.id)) for task in tasks]
    pile, caps = _Pile(texts, limits), _Caps(limits)
    found: dict[str, DuplicateTask] = {}
    for index in sorted(range(len(tasks)), key=_order(tasks, parents, limits)):
        task, text = tasks[index], texts[index]
        parent = parents.get(task.id)
        finding: _Finding | None = (parent, "parent") if parent is not None and parent in found else None
        if finding is None:
            finding = pile.repeated(text)
        if finding is None and parent is None and task.source in limits.synthetic:
            finding = caps.exceeded(text)
        if finding is None:
            pile.keep(text)
        else:
            found[task.id] = DuplicateTask(task.id, task.source, *finding)
    kept = [task for task in tasks if task.id not in found]
    return Deduplicated(kept, [found[task.id] for task in tasks if task.id in found])


def _order(
    tasks: Sequence[Task | SourceTask], parents: Mapping[str, str], limits: DuplicateLimits
) -> Callable[[int], tuple[int, int, bytes, str]]:
    """Generation, source, draw, id."""
    ranks = {source: rank for rank, source in enumerate(limits.sources)}

    def key(index: int) -> tuple[int, int, bytes, str]:
        task = tasks[index]
        drawn = b""
        if task.source in limits.synthetic:
            drawn = hashlib.blake2b(f"{limits.seed}/{task.id}".encode(), digest_size=8).digest()
        return _generation(task.id, parents), ranks.get(task.source, -1), drawn, task.id

    return key


def _generation(id: str, parents: Mapping[str, str]) -> int:
    """How many ancestors a task has; a ring of them is gone round once."""
    seen: set[str] = set()
    at = id
    while at in parents and at not in seen:
        seen.add(at)
        at = parents[at]
    return len(seen)


_NOTHING: Final = array("Q")


class _Text:
    """One task's text, taken apart as far as it was asked for."""

    __slots__ = ("_bag", "_names", "block", "family", "folded", "id", "key", "raw", "shingles", "site")

    def __init__(self, task: Task | SourceTask, family: str) -> None:
        self.id, self.raw, self.family = task.id, task.instruction, family
        self.folded = fold(task.instruction)
        self.site = "" if task.website is None else site_or_text(task.website)
        self.key = self.site, joined(self.folded)
        self.block = -1
        self.shingles = _NOTHING
        self._names: set[str] | None = None
        self._bag: frozenset[str] = frozenset()

    def words(self) -> list[str]:
        """All words but the website's own name."""
        own = self.site.partition(".")[0]
        words = self.folded.split()
        return [word for word in words if word != own] if own in words else words

    def says_the_same(self, other: _Text) -> bool:
        """Whether both have the same numbers and names in the same order."""
        here, there = self._named(), other._named()
        if not (here <= other._bag and there <= self._bag):
            return False  # what is a name in one is missing in the other
        return self._particulars(here | there) == other._particulars(here | there)

    def _named(self) -> set[str]:
        """Its names but the website's own. Many texts are compared with one, so they are remembered."""
        if self._names is None:
            self._bag = frozenset(self.words())
            self._names = names(self.raw) & self._bag
        return self._names

    def _particulars(self, wanted: set[str]) -> list[str]:
        """Its numbers, and its words among the wanted, in order."""
        found = []
        for word in self.words():
            if (value := number(word)) is not None:
                found.append(value)
            elif word in wanted:
                found.append(word)
        return found


class _Numbers(dict[str, "str | None"]):
    """The number that a word is or holds, remembered."""

    def __missing__(self, word: str) -> str | None:
        self[word] = value = number(word)
        return value


class _Pile:
    """The texts that are kept so far, and how to find those that a text repeats.

    Only texts of one block, a website and a bag of numbers, can be near; most blocks hold a single family.
    """

    def __init__(self, texts: Sequence[_Text], limits: DuplicateLimits) -> None:
        self._limits = limits
        self._same: dict[tuple[str, str], str] = {}
        self._near: dict[tuple[int, int], list[_Text]] = {}
        self._crowded = self._set_blocks(texts)
        often = Counter[str]()
        for text in texts:
            if text.block in self._crowded:
                often.update(text.folded.split())
        self._all = _bits(often.total())
        self._words = {
            word: (0, 0) if word in LITTLE else (_bits(often[word]), code)
            for code, word in enumerate(sorted(often), start=1)
        }

    @staticmethod
    def _set_blocks(texts: Sequence[_Text]) -> set[int]:
        """Say of every text which block it is in; the blocks that hold several families."""
        numbers = _Numbers()
        blocks: dict[tuple[str, ...], int] = {}
        family: dict[int, str] = {}
        crowded: set[int] = set()
        for text in texts:
            values = sorted(value for word in text.words() if (value := numbers[word]) is not None)
            text.block = blocks.setdefault((text.site, *values), len(blocks))
            if family.setdefault(text.block, text.family) != text.family:
                crowded.add(text.block)
        return crowded

    def repeated(self, text: _Text) -> _Finding | None:
        """The kept task that this one repeats, and how."""
        same = self._same.get(text.key)
        if same is not None:
            return same, "same"
        if text.block in self._crowded:
            self._take_apart(text)
            shingles = frozenset(text.shingles)
            for other in self._candidates(text):
                if self._overlap(shingles, other) and text.says_the_same(other):
                    return other.id, "near"
        return None

    def keep(self, text: _Text) -> None:
        """Be found by later texts."""
        self._same[text.key] = text.id
        for shingle in self._prefix(text):
            self._near.setdefault((text.block, shingle), []).append(text)

    def _take_apart(self, text: _Text) -> None:
        """Give every word and pair of words a number, the rarer the smaller: how rare it is, and which it is.

        A pair comes as often as its words would side by side by chance. The order need only be the same for
        all texts; that it begins with what is rare makes the search quick.
        """
        found: set[int] = set()
        before, last = 0, 0
        for word in text.words():
            often, code = self._words[word]
            if code:
                found.add(often << 48 | code)
                if last:
                    found.add(max(before + often - self._all, 0) << 48 | last << 24 | code)
                before, last = often, code
        text.shingles = array("Q", sorted(found))

    def _prefix(self, text: _Text) -> array[int]:
        shared = math.ceil(self._limits.similarity * len(text.shingles) - 1e-9)
        return text.shingles[: len(text.shingles) - shared + 1] if text.shingles else _NOTHING

    def _candidates(self, text: _Text) -> Iterator[_Text]:
        seen: set[str] = set()
        least = self._limits.similarity * len(text.shingles)
        most = len(text.shingles) / self._limits.similarity
        for shingle in self._prefix(text):
            for other in self._near.get((text.block, shingle), ()):
                if (
                    least <= len(other.shingles) <= most
                    and other.family != text.family
                    and other.id not in seen
                ):
                    yield other
                    seen.add(other.id)
                    if len(seen) == self._limits.compared:
                        return

    def _overlap(self, shingles: frozenset[int], other: _Text) -> bool:
        shared = len(shingles.intersection(other.shingles))
        return shared >= self._limits.similarity * (len(shingles) + len(other.shingles) - shared)


def _bits(count: int) -> int:
    """A logarithm that fits eight bits and tells frequencies apart by a tenth."""
    return round(8 * math.log2(count)) if count else 0


class _Caps:
    """How many tasks of synthetic sources are kept so far."""

    def __init__(self, limits: DuplicateLimits) -> None:
        self._limits = limits
        self._templates: dict[tuple[str, str], tuple[str, int]] = {}
        self._websites: Counter[str] = Counter()

    def exceeded(self, text: _Text) -> _Finding | None:
        """The limit that a task would break; if none, it counts."""
        key = (text.site, template(text.folded))
        first, count = self._templates.get(key, (text.id, 0))
        if count >= self._limits.per_template:
            return first, "template"
        if self._websites[text.site] >= self._limits.per_website:
            return "", "website"
        self._templates[key] = (first, count + 1)
        self._websites[text.site] += 1
        return None
