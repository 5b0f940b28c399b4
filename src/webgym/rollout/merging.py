"""Merge the runs of collectors that shared one task list into one run."""

from __future__ import annotations

import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from webgym.core.errors import ConfigError, RunFolderError
from webgym.core.settings import merged
from webgym.results.summary import Summary, summarise
from webgym.rollout.sharing import COLLECTORS, difference, shared_settings
from webgym.store.files import whole_folder
from webgym.store.records import Entry, pictures
from webgym.store.runs import RunReader, RunWriter, refuse_taken


class Merged(NamedTuple):
    """The result of a merge.

    Attributes:
        folder: of the merged run.
        runs: the number of runs that were merged.
        attempts: the number of attempts in the merged run.
        samples: the number of planned samples.
        missing: the number of samples without an attempt whose outcome counts.
        summary: the summary of the merged run.
    """

    folder: Path
    runs: int
    attempts: int
    samples: int
    missing: int
    summary: Summary

    def __str__(self) -> str:
        merged = f"{self.attempts:,} attempts of {self.runs} runs: {self.folder}"
        missing = f"\n{self.missing:,} of {self.samples:,} samples have no result" if self.missing else ""
        return merged + missing


def runs_in(folder: Path) -> list[Path]:
    """The run folders of a path.

    Args:
        folder: a run folder, or the folder in which collectors shared their task list.

    Raises:
        RunFolderError: the run folder of a collector does not exist on this machine.
    """
    if not (folder / COLLECTORS).is_dir():
        return [folder]
    runs = [Path(file.read_text()) for file in sorted((folder / COLLECTORS).glob("[!.]*"))]
    if absent := [run for run in runs if not run.is_dir()]:
        raise RunFolderError(
            f"the run folder {absent[0]} of a collector does not exist here", hint="give all run folders"
        )
    return runs


async def merge_runs(
    runs: Sequence[Path], out: Path, *, progress: Callable[[int, int], object] = lambda _done, _total: None
) -> Merged:
    """Write a run that contains the attempts of several runs.

    The attempts at a sample get new numbers, so that the one that counts is the last. Verdicts that were made
    later (``webgym judge RUN``) are not merged. The folder appears when the merge is complete: a part of it,
    resumed as a run, would repeat attempts.

    Args:
        runs: run folders of one task list, which are not changed.
        out: the folder of the merged run; it must not exist or be empty.
        progress: called with the number of attempts written so far and their total.

    Raises:
        ConfigError: the runs have different tasks, or different settings that influence rewards, or two of
            them completed the same sample, so that they cannot have shared a list.
        RunFolderError: a folder is no run, or ``out`` is not empty.
        StoreCorrupt: a record or a picture is damaged.
    """
    refuse_taken(out)
    readers = [RunReader(run) for run in dict.fromkeys(run.resolve() for run in runs)]
    first = readers[0]
    for other in readers[1:]:
        _refuse_different(first, other)
    with whole_folder(out) as unfinished:
        merged = await _write(readers, unfinished, progress)
    return merged._replace(folder=out, runs=len(runs))


async def _write(readers: Sequence[RunReader], out: Path, progress: Callable[[int, int], object]) -> Merged:
    """Write the merged run; see :func:`merge_runs`."""
    first, retries = readers[0], _new_numbers(readers)
    config = merged(first.config, {"collector": {"sharing": {"folder": None}}})
    config |= {"run_id": uuid.uuid4().hex, "merged_runs": [reader.config.get("run_id") for reader in readers]}
    async with await RunWriter.create(out, config, first.drawn) as writer:
        for reader in readers:
            # A collector may still write to the run: what it has recorded since is not numbered.
            numbered = [attempt_id for attempt_id in reader.attempts if (reader.path, attempt_id) in retries]
            for trajectory in reader.trajectories(numbered):
                for name in pictures(trajectory):
                    await writer.put_image(name, reader.image(name))
                episode = trajectory.episode
                retry = retries[reader.path, episode.attempt_id]
                attempt_id = f"{episode.task_id}#{episode.sample}.{retry}"
                episode = msgspec.structs.replace(episode, attempt_id=attempt_id, retry=retry)
                await writer.append(msgspec.structs.replace(trajectory, episode=episode))
                progress(len(writer.attempts), len(retries))
        completed = {
            (entry.task_id, entry.sample)
            for entry in writer.attempts.values()
            if not entry.outcome.is_retried
        }
        any_summary: Mapping[str, Any] = next((stored for run in readers if (stored := run.summary)), {})
        samples = first.samples * len(first.drawn)
        summary = summarise(
            RunReader(out).trajectories(),
            first.drawn,
            first.samples,
            seed=config.get("seed"),
            policy=any_summary.get("policy"),
            judge=any_summary.get("judge"),
        )
        await writer.write_summary(summary)
        missing = samples - len(completed)
        return Merged(out, len(readers), len(writer.attempts), samples, missing, summary)


def _refuse_different(first: RunReader, other: RunReader) -> None:
    """Raise an error if two runs cannot be merged.

    Raises:
        ConfigError: their tasks differ, or settings that influence rewards.
    """
    if first.drawn != other.drawn:  # in any field: another truth or rubric gives other rewards
        raise ConfigError(f"{first.path} and {other.path} have different tasks")
    if name := difference(shared_settings(first.config), shared_settings(other.config)):
        raise ConfigError(f"{first.path} and {other.path} differ in their settings of {name!r}")


def _new_numbers(readers: Sequence[RunReader]) -> dict[tuple[Path, str], int]:
    """New numbers of attempts: by run and attempt id, the index among all attempts at the sample.

    Raises:
        ConfigError: two runs completed the same sample.
    """
    attempts: defaultdict[tuple[str, int], list[tuple[Path, Entry]]] = defaultdict(list)
    for reader in readers:
        for entry in reader.attempts.values():
            attempts[entry.task_id, entry.sample].append((reader.path, entry))
    numbers: dict[tuple[Path, str], int] = {}
    for (task_id, sample), entries in attempts.items():
        ends = Counter(path for path, entry in entries if not entry.outcome.is_retried)
        if len(ends) > 1:
            raise ConfigError(
                f"{' and '.join(map(str, ends))} both completed sample {sample} of {task_id}",
                hint="merge runs that shared one task list (--share); for others use webgym compare",
            )
        entries.sort(key=lambda item: not item[1].outcome.is_retried)
        numbers |= {(path, entry.attempt_id): number for number, (path, entry) in enumerate(entries)}
    return numbers
