"""Pushing a folder with a card to the Hugging Face hub, for ``webgym tasks push`` and ``export --push``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

from webgym.core.errors import ConfigError, TaskFileError
from webgym.core.task import LEVELS, Task

if TYPE_CHECKING:
    from webgym.results.export import Exported
    from webgym.tasks.hub import Address

PushTo: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--push",
        help="Then push the folder, with a card, to this data set on the hub: hub:OWNER/NAME[@BRANCH].",
        show_default=False,
    ),
]
Public: TypeAlias = Annotated[
    bool, typer.Option("--public/--private", help="Whether everybody may read a data set that is made.")
]

_CARD: Final = "README.md"
_REPLACED: Final = ("*.jsonl", "*.parquet", "sharegpt.json", "pictures/*")
"""Patterns of what an earlier push may have left in a data set."""
_TASKS: Final = """\
Tasks for agents that use web browsers, in the format of
[WebGym](https://arxiv.org/abs/2601.02439)'s published set: a row is an instruction (`task_name`), the
website it starts on, and fact groups that a trajectory must show (`evaluator_reference`).

    webgym rollout --tasks {address}
"""
_STEPS: Final = """\
Steps of agents that used web browsers: a row is a step with the request, its pictures, the reply, and the
outcome and reward of the attempt (null if it has none), as `webgym export` of WebGym {version} writes them.
"""


def target(text: str) -> Address:
    """The data set that a folder is pushed to.

    Raises:
        ConfigError: it is no address, or that of a part.
    """
    from webgym.tasks.hub import HUB, address_of

    address = address_of(text) or address_of(f"{HUB}{text}")
    if address is None or address.part:
        raise ConfigError(f"{text!r} is no data set on the hub", hint="give hub:OWNER/NAME[@BRANCH]")
    return address


def push_folder(folder: Path, to: Address, card: str, *, is_public: bool) -> None:
    """Write the card into a folder, push it in place of the data set's files, and print the commit."""
    from webgym.tasks.hub import push

    (folder / _CARD).write_text(card.replace("{address}", str(to._replace(revision=None))))
    said = f"Pushed with WebGym {version('webgym-rl')}"
    commit = push(folder, to, said, is_public=is_public, replaces=_REPLACED)
    print(f"pushed to {commit}")


def tasks_card(tasks: Sequence[Task], files: Mapping[str, str], licence: str | None = None) -> str:
    """The card of a task set.

    Args:
        tasks: all of them.
        files: names of the files by split; without any, the hub finds them itself.
        licence: identifier of the licence that the set is published under.

    Raises:
        TaskFileError: a source of the tasks is published encrypted, so that no crawl finds it.
    """
    from webgym.tasks.sources import ENCRYPTED_SOURCE, SOURCES

    if encrypted := sum(ENCRYPTED_SOURCE in task.flags for task in tasks):
        raise TaskFileError(
            f"{encrypted:,} of {len(tasks):,} tasks are of a source that is published encrypted",
            hint="leave them out: in plain text they would get into crawls",
        )
    sources = Counter(task.source for task in tasks)
    rows = [
        (name, f"{count:,}", SOURCES[name].licence if name in SOURCES else "")
        for name, count in sources.most_common()
    ]
    levels = Counter((task.split or "unsplit", task.level) for task in tasks)
    splits = dict.fromkeys(split for split, _ in levels)
    counts = [(split, *(f"{levels[split, level]:,}" for level in LEVELS)) for split in splits]
    body = (_TASKS, *_table(("split", *LEVELS), counts), *_table(("source", "tasks", "its licence"), rows))
    return _card(body, "Tasks for web agents", files, licence)


def steps_card(run: Path, result: Exported, kind: str) -> str:
    """The card of a run's steps."""
    from webgym.core.text import plain

    counts = [(f"{result.attempts:,}", f"{result.steps:,}", f"{result.pictures:,}", kind)]
    made = f"Run `{plain(run.resolve().name)}`, policy {plain(', '.join(sorted(result.policies)))}."
    body = (
        _STEPS.format(version=version("webgym-rl")),
        made,
        *_table(("attempts", "steps", "pictures", "format"), counts),
    )
    return _card(body, "Steps of web agents", {}, None)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    lines = [head, ["---"] * len(head), *rows]
    yield "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _card(body: Sequence[str], title: str, files: Mapping[str, str], licence: str | None) -> str:
    """A card with its metadata, which the hub reads."""
    import yaml

    data = {"pretty_name": title, "tags": ["webgym", "web-agents"]}
    if licence:
        data["license"] = licence
    if files:
        parts = [{"split": split, "path": path} for split, path in files.items()]
        data["configs"] = [{"config_name": "default", "data_files": parts}]  # type: ignore[list-item]
    metadata = yaml.safe_dump(data, sort_keys=False)
    return "\n\n".join((f"---\n{metadata}---", f"# {title}", *body)) + "\n"
