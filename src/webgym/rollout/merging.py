"""Runs of collectors that shared one task list, put together as one run."""

from __future__ import annotations

import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from webgym.core.errors import ConfigError, RunFolderError
from webgym.rollout.records import Entry, pictures
from webgym.rollout.sharing import COLLECTORS
from webgym.rollout.store import RunReader, RunWriter
from webgym.rollout.summary import Summary, summarise

_SAME: Final = ("seed", "samples", "policy", "agent", "judge", "attempt")
"""What decides on attempts and their rewards; machines, browsers and limits may differ from run to run."""
_ANYWHERE: Final = frozenset({"base_url", "cache", "concurrency", "adapt"})
"""Of a model's endpoint: where it is and how fast it may be asked."""


class Merged(NamedTuple):
    """The result of a merge.

    Attributes:
        attempts: in the merged run.
        samples: that were planned.
        missing: of them no attempt ended in an outcome that counts.
        summary: of the merged run.
    """

    attempts: int
    samples: int
    missing: int
    summary: Summary


def runs_in(folder: Path) -> list[Path]:
    """The run folders that a path stands for.

    Args:
        folder: a run folder, or the folder in which collectors have shared their task list.

    Raises:
        RunFolderError: a collector's run folder cannot be read from here.
    """
    if not (folder / COLLECTORS).is_dir():
        return [folder]
    runs = [Path(file.read_text()) for file in sorted((folder / COLLECTORS).glob("[!.]*"))]
    if away := [run for run in runs if not run.is_dir()]:
        raise RunFolderError(
            f"the run folder {away[0]} of a collector is not there", hint="name the run folders one by one"
        )
    return runs


async def merge_runs(
    runs: Sequence[Path], out: Path, *, progress: Callable[[int, int], object] = lambda _done, _total: None
) -> Merged:
    """Write one run that holds the attempts of several.

    Attempts at one sample are numbered anew, so that the one that counts comes last. Verdicts that were made
    after the runs (``webgym judge RUN``) stay with them.

    Args:
        runs: run folders of one task list; they are only read.
        out: of the merged run; does not exist yet or is empty.
        progress: is told how many attempts of how many are written.

    Raises:
        ConfigError: the runs differ in their tasks or in what decides on rewards, or two of them hold the
            end of one sample, so that they did not share a list.
        RunFolderError: a folder is no run, or ``out`` holds something.
        StoreCorrupt: a record or a picture cannot be trusted.
    """
    readers = [RunReader(run) for run in dict.fromkeys(run.resolve() for run in runs)]
    first = readers[0]
    for other in readers[1:]:
        _refuse_different(first, other)
    retries = _numbered(readers)
    config = first.config
    config["collector"]["sharing"]["folder"] = None
    config |= {"run_id": uuid.uuid4().hex, "merged_runs": [reader.config["run_id"] for reader in readers]}
    async with await RunWriter.create(out, config, first.drawn) as writer:
        for reader in readers:
            for trajectory in reader.trajectories():
                for name in pictures(trajectory):
                    await writer.put_image(name, reader.image(name))
                episode = trajectory.episode
                retry = retries[reader.path, episode.attempt_id]
                attempt_id = f"{episode.task_id}#{episode.sample}.{retry}"
                episode = msgspec.structs.replace(episode, attempt_id=attempt_id, retry=retry)
                await writer.append(msgspec.structs.replace(trajectory, episode=episode))
                progress(len(writer.attempts), len(retries))
        ended = {
            (entry.task_id, entry.sample)
            for entry in writer.attempts.values()
            if not entry.outcome.is_retried
        }
        told: Mapping[str, Any] = next((held for reader in readers if (held := reader.summary)), {})
        samples = config["samples"] * len(first.drawn)
        summary = summarise(
            RunReader(out).trajectories(),
            first.drawn,
            config["samples"],
            seed=config["seed"],
            policy=told.get("policy"),
            judge=told.get("judge"),
        )
        await writer.write_summary(summary)
        return Merged(len(writer.attempts), samples, samples - len(ended), summary)


def _refuse_different(first: RunReader, other: RunReader) -> None:
    if [task.id for task in first.drawn] != [task.id for task in other.drawn]:
        raise ConfigError(f"{first.path} and {other.path} have different tasks")
    ours, theirs = first.config, other.config
    for name in _SAME:
        if _anywhere(ours[name]) != _anywhere(theirs[name]):
            raise ConfigError(f"{first.path} and {other.path} differ in their settings of {name!r}")


def _anywhere(settings: Any) -> Any:
    """Settings without what may differ from machine to machine."""
    if isinstance(settings, dict):
        return {name: _anywhere(value) for name, value in settings.items() if name not in _ANYWHERE}
    return settings


def _numbered(readers: Sequence[RunReader]) -> dict[tuple[Path, str], int]:
    """By run and attempt: the attempt's number at its sample over all runs.

    Raises:
        ConfigError: two runs hold the end of one sample.
    """
    attempts: defaultdict[tuple[str, int], list[tuple[Path, Entry]]] = defaultdict(list)
    for reader in readers:
        for entry in reader.attempts.values():
            attempts[entry.task_id, entry.sample].append((reader.path, entry))
    numbers = {}
    for (task_id, sample), held in attempts.items():
        ends = Counter(path for path, entry in held if not entry.outcome.is_retried)
        if len(ends) > 1:
            raise ConfigError(
                f"{' and '.join(map(str, ends))} both hold the end of sample {sample} of {task_id}",
                hint="merge runs that shared one task list (--share); webgym compare is for others",
            )
        held.sort(key=lambda each: not each[1].outcome.is_retried)
        numbers |= {(path, entry.attempt_id): number for number, (path, entry) in enumerate(held)}
    return numbers
