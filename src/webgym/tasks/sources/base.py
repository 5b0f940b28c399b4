"""What every source of tasks has in common."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import msgspec

from webgym.core.task import Rubric, WebsiteFrom
from webgym.core.websites import site_of
from webgym.tasks.sources.companions import Companions
from webgym.tasks.sources.fields import Fields
from webgym.tasks.sources.problems import PassedOver

DATED = "dated"
"""The instruction names a day, a month or a year that has passed. It is never rewritten here."""
ENCRYPTED_SOURCE = "encrypted-source"
"""The source is published encrypted so that no crawler reads it (BrowseComp). Whoever writes tasks to a file
must leave these out, unless the user has asked for their plain text by the source's name."""
PLACEHOLDER_WEBSITE = "placeholder-website"
"""The record names a website that stands for "the web" (GAIA); the task's own is to be inferred."""
BAD_WEBSITE = "bad-website"
"""What the record gives as a website names none; it is to be inferred."""
GARBLED = "garbled"
"""A value beside the instruction cannot be read, and was left out."""
OUTDATED_ANSWER = "outdated-answer"
"""An answer that lies beside the tasks has the task's id, and was given to an older text."""
NEEDS_FILE = "needs-file"
"""The task comes with a file that is not part of it here."""


CHATS = frozenset({"messages"})
"""Fields that hold a conversation in which the instruction is the user's turn."""


class SourceTask(msgspec.Struct, frozen=True, omit_defaults=True):
    """A task as its source gives it: no rubric needed, and maybe no website.

    Attributes:
        id: ``<source>/<native id>``; no two sources clash.
        source: name of the benchmark, a key of :data:`webgym.tasks.sources.SOURCES`.
        instruction: what the agent reads, unchanged but for surrounding white space.
        website: URL where the attempt starts; ``None`` where one has to be inferred.
        website_from: where ``website`` comes from; ``"inferred"`` while there is none.
        domain, subdomain: of the taxonomy, where the source's own category leaves no doubt; else empty, and
            to be inferred. The published set's are kept as they are.
        reference_answer: overrides the judge.
        example_answer: one of several good answers; never overrides the judge.
        hints: steps and criteria of the source, for whoever writes the rubric. May hold the answer.
        rubric: where the source has one of our shape.
        flags: what to know about it, such as :data:`DATED`; the names are in this module.
        extra: columns of the published set that are not used here.
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
    flags: tuple[str, ...] = ()
    extra: dict[str, object] = {}


class Skipped(msgspec.Struct, frozen=True):
    """A record that gave no task.

    Attributes:
        file: as it was given.
        place: line, row or key in it.
        reason: what is wrong with it. Never quotes what the record says.
    """

    file: str
    place: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}, {self.place}: {self.reason}"


@dataclass
class Draft:
    """What a record says, before it is checked: the work of one source's file.

    Attributes:
        instruction: as :class:`SourceTask`'s.
        native_id: the source's own; ``None`` where it has none.
        website: as the record gives it, a bare host or a URL; ``None`` if it gives none.
        website_from: where from, if there is one.
        dates: texts beside the instruction that say when it is about.
    """

    instruction: str
    native_id: str | None = None
    website: str | None = None
    website_from: WebsiteFrom = "given"
    domain: str = ""
    subdomain: str = ""
    reference_answer: str | None = None
    example_answer: str | None = None
    hints: tuple[str, ...] = ()
    rubric: Rubric | None = None
    flags: list[str] = field(default_factory=list)
    dates: tuple[str, ...] = ()
    extra: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """One benchmark.

    Attributes:
        name: as in ids and on the command line.
        paper_tasks, paper_websites: as the paper's Table 1 counts them.
        licence: of the data, where its publisher states one.
        instruction: names of the field that holds the instruction; a record is known by it.
        draft: what a record says.
        marks: sets of fields that tell its records: what has all of one is its record, unless it has all of a
            larger one of another source.
        timeless: its questions are about the past and their answers do not change, so that none is dated.
        synthetic: the tasks were made by a model, so that near-duplicates are to be expected (paper §3).
        beside: patterns of files that belong to the tasks' file and hold no tasks themselves.
    """

    name: str
    paper_tasks: int
    paper_websites: int
    licence: str
    instruction: tuple[str, ...]
    draft: Callable[[Fields, Companions], Draft]
    marks: tuple[tuple[str, ...], ...] = ()
    timeless: bool = False
    synthetic: bool = False
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Read:
    """What a source held. ``records == len(tasks) + len(skipped)``, always.

    Attributes:
        name: of the source.
        tasks: in the order of the files.
        skipped: the records that gave no task, and why.
        records: how many there were.
        passed_over: files of a folder that hold no tasks, and companions that could not be read.
    """

    name: str
    tasks: list[SourceTask]
    skipped: list[Skipped]
    records: int
    passed_over: tuple[PassedOver, ...] = ()

    def flags(self) -> Counter[str]:
        """How many tasks carry each flag."""
        return Counter(flag for task in self.tasks for flag in task.flags)

    def websites(self) -> int:
        """How many websites there are, by registrable domain; those to be inferred do not count."""
        return len(sites(self.tasks))

    def websites_from(self) -> Counter[WebsiteFrom]:
        """How many tasks have their website from where."""
        return Counter(task.website_from for task in self.tasks)


def sites(tasks: Iterable[SourceTask]) -> set[str]:
    """The websites of tasks, as :func:`webgym.core.websites.site_of` names them."""
    urls = {task.website for task in tasks}
    return {site_of(url) for url in urls if url is not None}
