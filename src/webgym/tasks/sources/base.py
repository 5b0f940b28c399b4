"""What every source of tasks has in common."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import msgspec

from webgym.core.task import Rubric, WebsiteFrom


class SourceTask(msgspec.Struct, frozen=True, omit_defaults=True):
    """A task as its source gives it: no rubric needed, and maybe no website.

    Attributes:
        id: ``<source>/<native id>``; no two sources clash.
        source: name of the benchmark, a key of :data:`webgym.tasks.sources.SOURCES`.
        instruction: what the agent reads, unchanged but for surrounding white space.
        website: URL where the attempt starts; ``None`` where one has to be inferred.
        website_from: where ``website`` comes from; ``"inferred"`` while there is none.
        domain, subdomain: as the source names them; empty if it does not.
        reference_answer: overrides the judge.
        example_answer: one of several good answers; never overrides the judge.
        hints: steps and criteria of the source, for whoever writes the rubric. May hold the answer.
        rubric: where the source has one of our shape.
        flags: such as ``"dated"``: it names a date that has passed.
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
        reason: what is wrong with it.
    """

    file: str
    place: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}:{self.place}: {self.reason}"


class Source(Protocol):
    """One benchmark.

    Attributes:
        name: of the source, as in ids.
        paper_tasks, paper_websites: as the paper's Table 1 counts them.
    """

    name: str
    paper_tasks: int
    paper_websites: int

    def read(self, path: Path) -> Iterator[SourceTask | Skipped]:
        """Every record of a file or a folder of files, in order: a task, or why there is none.

        Raises:
            TaskFileError: there is nothing of this source there.
        """
