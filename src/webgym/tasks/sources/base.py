"""Types and flags that all sources of tasks share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from webgym.core.task import Level, Rubric, WebsiteFrom
from webgym.core.websites import site_of
from webgym.tasks.sources.fields import Companions, Fields, PassedOver

DATED = "dated"
"""Flag: the instruction contains a day, a month or a year that has passed. The date is never changed."""
ENCRYPTED_SOURCE = "encrypted-source"
"""Flag: the source is published encrypted, to keep it out of crawls (BrowseComp). Such tasks must not be
written to a file unless the user has requested their plain text by the source's name."""
PLACEHOLDER_WEBSITE = "placeholder-website"
"""Flag: the record's website is a placeholder for "the web" (GAIA); the task's website has to be inferred."""
BAD_WEBSITE = "bad-website"
"""Flag: the record's website is invalid; it has to be inferred."""
GARBLED = "garbled"
"""Flag: a value other than the instruction cannot be read, and was left out."""
OUTDATED_ANSWER = "outdated-answer"
"""Flag: the file of answers has an answer with the task's id, but for an older or another text."""
NEEDS_FILE = "needs-file"
"""Flag: the task needs a file that is not included."""


CHATS = frozenset({"messages"})
"""Fields with a conversation whose user message is the instruction."""


class SourceTask(msgspec.Struct, frozen=True, omit_defaults=True):
    """A task as its source provides it, possibly without a rubric and a website.

    Attributes:
        id: ``<source>/<native id>``; unique over all sources.
        source: name of the benchmark, a key of :data:`webgym.tasks.sources.SOURCES`.
        instruction: what the agent reads, unchanged except for surrounding white space.
        website: URL where the attempt starts; ``None`` if it has to be inferred.
        website_from: origin of ``website``; ``"inferred"`` while there is none.
        domain, subdomain: of the taxonomy, if the source's own category determines them; else empty, to be
            inferred. The published set's are kept unchanged.
        reference_answer: overrides the judge.
        example_answer: one of several good answers; never overrides the judge.
        hints: steps and criteria of the source, as help for writing the rubric. May contain the answer.
        rubric: if the source has fact groups.
        parent_id: the task of the same source that it was derived from.
        split: of the published set.
        flags: such as :data:`DATED`; all are in this module.
        extra: unused columns of the published set.
        level: that the source states.
    """

    id: str
    source: str
    instruction: str
    website: str | None = None
    website_from: WebsiteFrom = "inferred"
    domain: str = ""
    subdomain: str = ""
    reference_answer: str | None = None
    example_answer: str | None = None
    hints: tuple[str, ...] = ()
    rubric: Rubric | None = None
    parent_id: str | None = None
    split: Literal["train", "test"] | None = None
    flags: tuple[str, ...] = ()
    extra: dict[str, object] = {}
    level: Level | None = None


class Skipped(msgspec.Struct, frozen=True):
    """A record that gave no task.

    Attributes:
        file: path of the file.
        place: line, row or key of the record in it.
        reason: what is wrong with it, without quoting the record.
    """

    file: str
    place: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}, {self.place}: {self.reason}"


@dataclass
class Draft:
    """The values of a record, read by one source's module and not checked yet.

    Attributes not listed are as in :class:`SourceTask`.

    Attributes:
        native_id, native_parent_id: the ids of the record and of its parent in its source; ``None`` if it has
            none.
        joined: whether the answer is from a companion file that has no more of the record than its id.
        website: as in the record, a bare host or a URL; ``None`` if it has none.
        website_from: origin of ``website``, if there is one.
        dates: texts other than the instruction with the dates that the task is about.
    """

    instruction: str
    native_id: str | None = None
    website: str | None = None
    website_from: WebsiteFrom = "given"
    domain: str = ""
    subdomain: str = ""
    reference_answer: str | None = None
    example_answer: str | None = None
    joined: bool = False
    hints: tuple[str, ...] = ()
    rubric: Rubric | None = None
    native_parent_id: str | None = None
    split: Literal["train", "test"] | None = None
    flags: list[str] = field(default_factory=list)
    dates: tuple[str, ...] = ()
    extra: dict[str, object] = field(default_factory=dict)
    level: Level | None = None


@dataclass(frozen=True)
class Source:
    """One benchmark.

    Attributes:
        name: as in ids and on the command line.
        paper_tasks, paper_websites: counts in the paper's Table 1.
        licence: of the data, if its publisher states one.
        instruction: possible names of the field with the instruction, which every record has.
        draft: reads a record.
        marks: sets of fields that identify its records: a record with all fields of a set is of this source,
            unless it has all fields of a larger set of another source.
        timeless: the questions are about the past and their answers do not change, so no task is dated.
        beside: patterns of companion files, which have no tasks themselves.
        is_split: its files' names, ``train`` or ``test``, say which split a task is in.
    """

    name: str
    paper_tasks: int
    paper_websites: int
    licence: str
    instruction: tuple[str, ...]
    draft: Callable[[Fields, Companions], Draft]
    marks: tuple[tuple[str, ...], ...] = ()
    timeless: bool = False
    beside: tuple[str, ...] = ()
    is_split: bool = False


@dataclass(frozen=True)
class Read:
    """The contents of a source. ``records == len(tasks) + len(skipped)``, always.

    Attributes:
        name: of the source.
        tasks: in the order of the files.
        skipped: records that gave no task, and why.
        records: number of records.
        passed_over: files of a folder without tasks, and companions that could not be read.
    """

    name: str
    tasks: list[SourceTask]
    skipped: list[Skipped]
    records: int
    passed_over: tuple[PassedOver, ...] = ()

    def flags(self) -> Counter[str]:
        """Number of tasks with each flag."""
        return Counter(flag for task in self.tasks for flag in task.flags)

    def websites(self) -> int:
        """Number of websites by registrable domain, without those still to be inferred."""
        return len(sites(self.tasks))

    def websites_from(self) -> Counter[WebsiteFrom]:
        """Number of tasks by the origin of their website."""
        return Counter(task.website_from for task in self.tasks)


def sites(tasks: Iterable[SourceTask]) -> set[str]:
    """The registrable domains of the tasks' websites."""
    urls = {task.website for task in tasks}
    return {site_of(url) for url in urls if url is not None}
