"""Tasks and rubrics (paper §3).

They contain no reference cycles, and a task set has hundreds of thousands of them, so the garbage collector
does not track them (``gc=False``).
"""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any, Final, Literal, TypeAlias

import msgspec

from webgym.core.identity import check_fields
from webgym.core.truth import Truth

Level: TypeAlias = Literal["easy", "medium", "hard"]
LEVELS: tuple[Level, ...] = ("easy", "medium", "hard")

WebsiteFrom: TypeAlias = Literal["given", "derived", "inferred"]

EASY_AT_MOST = 3
MEDIUM_AT_MOST = 6
LARGE_GROUP_AT_LEAST = 3
"""A fact group of this size makes a task worth decomposing (paper Algorithm 1)."""


def level_of(difficulty: int) -> Level:
    """Easy 1-3, medium 4-6, hard from 7 (paper §3)."""
    if difficulty <= EASY_AT_MOST:
        return "easy"
    return "medium" if difficulty <= MEDIUM_AT_MOST else "hard"


class FactGroup(msgspec.Struct, frozen=True, gc=False):
    """Facts that belong together. An OR stays inside one fact, in capitals.

    Attributes:
        id: its number, unique in the rubric.
        description: what the facts have in common.
        facts: each a sentence that a trajectory must show to be true.

    Raises:
        ValueError: the group has no fact, or one that is empty.
    """

    id: int
    description: str
    facts: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.facts or not all(map(str.strip, self.facts)):
            raise ValueError(f"fact group {self.id} is empty or contains an empty fact")

    @property
    def is_large(self) -> bool:
        """Whether the group has three facts or more."""
        return len(self.facts) >= LARGE_GROUP_AT_LEAST


class Rubric(msgspec.Struct, frozen=True, gc=False):
    """Fact groups, all of whose facts must hold (AND).

    Attributes:
        groups: in the order in which a judge reads them.

    Raises:
        ValueError: there is no group, or two groups have the same id.
    """

    groups: tuple[FactGroup, ...]

    def __post_init__(self) -> None:
        if not self.groups:
            raise ValueError("a rubric needs at least one fact group")
        if len(self.groups) > 1 and len({group.id for group in self.groups}) != len(self.groups):
            raise ValueError("two fact groups have the same id")

    @property
    def difficulty(self) -> int:
        """The total number of facts."""
        return sum(len(group.facts) for group in self.groups)

    def decompositions(self) -> list[Rubric]:
        """The rubrics of the tasks that can be derived from one with this rubric (paper Algorithm 1).

        Returns:
            Every proper, non-empty subset of the groups that contains a large group, smaller subsets
            first. Empty unless there are at least two groups and a large one.
        """
        return [
            Rubric(chosen)
            for size in range(1, len(self.groups))
            for chosen in combinations(self.groups, size)
            if any(group.is_large for group in chosen)
        ]

    def facts(self) -> list[tuple[FactGroup, int, str]]:
        """Every fact as ``(group, index in the group, text)``, in order."""
        return [(group, index, fact) for group in self.groups for index, fact in enumerate(group.facts)]


WHOLE_TASK = Rubric(
    (FactGroup(1, "the whole task", ("Everything that the task asks for was done or found.",)),)
)
"""The rubric of a task that comes without one: a single generic fact."""


MAX_ATTACHED_BYTES = 512 * 1024
"""Largest total size of a task's files: they are sent with every session."""

_INVALID_FILE_NAME = re.compile(r"[/\\\x00-\x1f\x7f\ud800-\udfff]|^\.{1,2}$")


class Attachment(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """A file that a task comes with, which the agent may choose in a page's file chooser.

    Attributes:
        name: the file name that the page sees.
        text: its content as text, encoded as UTF-8; or else
        data: its content as bytes (base64 in JSON).

    Raises:
        ValueError: the file name is invalid, or both text and data are given.
    """

    name: str
    text: str = ""
    data: bytes = b""

    def __post_init__(self) -> None:
        if not self.name.strip() or _INVALID_FILE_NAME.search(self.name) or len(self.name.encode()) > 200:
            raise ValueError(f"{self.name[:100]!r} is not a valid file name")
        if self.text and self.data:
            raise ValueError(f"the file {self.name!r} has both text and data")

    @property
    def content(self) -> bytes:
        """The content of the file."""
        return self.data or self.text.encode()


def check_attachments(files: tuple[Attachment, ...]) -> None:
    """Check the files of one task.

    Raises:
        ValueError: two have the same name, or their total size is above :data:`MAX_ATTACHED_BYTES`.
    """
    if len({file.name for file in files}) < len(files):
        raise ValueError("two files of a task have the same name")
    if sum(len(file.content) for file in files) > MAX_ATTACHED_BYTES:
        raise ValueError(f"the files of a task have more than {MAX_ATTACHED_BYTES:,} bytes")


_MISSING: Final = frozenset(
    {"", "nan", "<na>", "null", "n/a", "#n/a", "undefined", "-", "--", "–", "—", "**"}
)
_MISSING_AS_WRITTEN: Final = frozenset({"None", "NaT"})
_AROUND_MISSING: Final = " \t\r\n[](){}'\""


def reference_of(text: str | None) -> str | None:
    """A reference answer, or ``None`` if the text stands for a missing one, as programs write it.

    All readers of tasks and the judge ask this. A reference answer overrides the judge, so ``nan`` taken for
    one would be a reward of 0. "None" is what Python writes; "none", "no" and "0" are answers, as in GAIA.
    """
    bare = (text or "").strip().strip(_AROUND_MISSING)
    return None if bare in _MISSING_AS_WRITTEN or bare.casefold() in _MISSING else text


class Task(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """One thing to do on one website.

    Attributes:
        id: unique over all sources, namespaced by source (``"offline/fernhill-books/cheapest-1"``).
        instruction: what the agent is to do, as the prompt states it.
        website: the URL where the attempt starts.
        domain, subdomain: in the Mind2Web-2 taxonomy.
        rubric: what a trajectory must show.
        source: the benchmark it comes from; ``"offline"`` for the offline web.
        reference_answer: overrides the judge where there is one (paper §3.4).
        example_answer: one of several good answers; never overrides the judge.
        parent_id: the task it was decomposed from.
        split: ``"train"`` or ``"test"`` once split.
        website_from: whether the source gave the website, it was derived from other fields of the record, or
            a model inferred it.
        flags: properties to filter tasks by, such as ``"dated"``.
        extra: unused columns of the published set, kept so that it can be written again without loss.
        truth: the ground truth, for the offline judge and the scripted policy; never shown to a model.
        files: files that the agent may upload, in the extended action space.
        identity: fields of :class:`~webgym.core.identity.Identity` that this task needs, such as a place.
        stated_level: the level that a benchmark states itself; by default the rubric's.

    Raises:
        ValueError: two of its files have the same name, or they are too large, or it asks for an identity
            that there is not.
    """

    id: str
    instruction: str
    website: str
    domain: str
    subdomain: str
    rubric: Rubric
    source: str
    reference_answer: str | None = None
    example_answer: str | None = None
    parent_id: str | None = None
    split: Literal["train", "test"] | None = None
    website_from: WebsiteFrom = "given"
    flags: tuple[str, ...] = ()
    extra: dict[str, Any] = {}
    truth: Truth | None = None
    files: tuple[Attachment, ...] = ()
    identity: dict[str, Any] = {}
    stated_level: Level | None = None

    def __post_init__(self) -> None:
        if self.files:
            check_attachments(self.files)
        if self.identity:
            check_fields(self.identity)

    @property
    def difficulty(self) -> int:
        """The total number of facts over all groups."""
        return self.rubric.difficulty

    @property
    def level(self) -> Level:
        """Easy, medium or hard."""
        return self.stated_level or level_of(self.rubric.difficulty)


class StepBudget(msgspec.Struct, frozen=True):
    """How many steps an attempt may take, by level (paper §5)."""

    easy: int = 15
    medium: int = 30
    hard: int = 45

    def for_task(self, task: Task) -> int:
        """The budget of this task, in steps."""
        return {"easy": self.easy, "medium": self.medium, "hard": self.hard}[task.level]
