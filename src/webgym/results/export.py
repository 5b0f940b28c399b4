"""Export of a run for other programs: a row per step, as JSON lines, Parquet or ShareGPT (LLaMA-Factory).

A row contains the request and the reply, with the outcome and the reward of the attempt. The reward is
``null`` if the attempt has none, never 0.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from webgym.agent.image_codec import fit
from webgym.agent.profiles import all_profiles, choose_profile
from webgym.core.errors import StoreCorrupt, UsageError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import ImageRef, Message, Step, TextPart, Trajectory
from webgym.results.summary import oracle_notes
from webgym.store.files import disk_errors, whole_folder, write_lines
from webgym.store.runs import RunReader
from webgym.tasks.split import leaking

Format: TypeAlias = Literal["jsonl", "parquet", "sharegpt"]

PICTURES: Final = "pictures"
_IMAGE: Final = "<image>"
_ROWS: Final = 256
"""Rows per row group of Parquet; few, because pictures are large."""
_SCHEMA: Final = pa.schema(
    [
        ("attempt_id", pa.string()),
        ("task_id", pa.string()),
        ("sample", pa.int32()),
        ("split", pa.string()),
        ("level", pa.string()),
        ("website", pa.string()),
        ("instruction", pa.string()),
        ("outcome", pa.string()),
        ("reward", pa.float32()),
        ("policy", pa.string()),
        ("weight_version", pa.string()),
        ("step", pa.int32()),
        ("steps", pa.int32()),
        ("messages", pa.string()),
        ("images", pa.list_(pa.struct([("bytes", pa.binary()), ("path", pa.string())]))),
        ("reply", pa.string()),
        ("reasoning", pa.string()),
        ("action", pa.string()),
        ("parse_error", pa.string()),
        ("changed", pa.bool_()),
        ("prompt_ids", pa.list_(pa.int32())),
        ("reply_ids", pa.list_(pa.int32())),
        ("reply_logprobs", pa.list_(pa.float32())),
    ]
)


class Exported(msgspec.Struct):
    """The result of an export.

    Attributes:
        folder: of the files.
        attempts, steps, pictures: numbers in the files.
        unrewarded: attempts left out because of their outcome.
        other_split: attempts left out because their task belongs to another split, or leaks a test task of
            the run although it is for training.
        unusable: steps left out because the format cannot represent them.
        policies: whose steps they are.
    """

    folder: Path
    attempts: int = 0
    steps: int = 0
    pictures: int = 0
    unrewarded: int = 0
    other_split: int = 0
    unusable: int = 0
    policies: set[str] = set()

    def __str__(self) -> str:
        counts = {
            "attempts at tasks of another split": self.other_split,
            "attempts with other outcomes": self.unrewarded,
            "steps that the format cannot represent": self.unusable,
        }
        written = f"{self.steps:,} steps of {self.attempts:,} attempts, {self.pictures:,} pictures"
        notes = (*oracle_notes(sorted(self.policies)), *left_out_line(counts))
        return "\n".join((f"{written}: {self.folder}", *notes))


def left_out_line(counts: Mapping[str, int]) -> list[str]:
    """A line that says how much was left out, by what it is; none if it is nothing."""
    parts = [f"{count:,} {what}" for what, count in counts.items() if count]
    return [f"left out: {', '.join(parts)}"] if parts else []


def export(
    run: Path,
    out: Path,
    kind: Format,
    *,
    split: Literal["train", "test", "all"] = "train",
    outcomes: frozenset[Outcome] | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> Exported:
    """Export a run's steps for another program.

    Args:
        run: the run folder.
        out: a folder that does not exist yet or is empty. Once it is all written, it gets ``steps.jsonl``,
            ``steps.parquet``, or ``sharegpt.json`` with ``dataset_info.json`` and ``train.yaml``; the first
            and the last with ``pictures/``, in the sizes in which they were sent.
        kind: the format.
        split: split of the tasks to export. A task without one belongs to the split that the run's tasks were
            taken from; if that is not known either, it is only exported with ``all``, because it may not be
            for training.
        outcomes: outcomes of the attempts to export; by default only success for ``sharegpt``, which is for
            imitation learning, and all for the others.
        progress: called with the number of attempts read so far.

    Raises:
        UsageError: ``sharegpt`` with outcomes that have no reward.
        RunFolderError: the folder is not a run, or ``out`` is not empty.
        StoreError: a record is invalid, or the disk is full.
    """
    if outcomes is None:
        outcomes = frozenset({Outcome.SUCCESS}) if kind == "sharegpt" else frozenset(Outcome)
    if kind == "sharegpt" and not all(outcome.is_rewarded for outcome in outcomes):
        raise UsageError("attempts without a reward cannot be imitated", hint="leave them out")
    reader = RunReader(run)
    reader.refresh()  # a damaged record is told before there is a folder
    for entry in reader.attempts.values():
        if entry.task_id not in reader.tasks:
            why = f"{entry.attempt_id}: the run does not hold its task {entry.task_id}"
            raise StoreCorrupt(why, hint="webgym verify RUN counts such attempts")
    with whole_folder(out) as folder, disk_errors(f"writing to {out}", "export again"):
        exporter = _Exporter(reader, folder, split, outcomes, progress)
        if kind == "parquet":
            exporter.write_parquet(folder / "steps.parquet")
        elif kind == "jsonl":
            encoded = (msgspec.json.encode(row) + b"\n" for row in exporter.rows())
            write_lines(folder / "steps.jsonl", encoded)
        else:
            write_lines(folder / "sharegpt.json", _array(exporter.conversations()))
            write_lines(folder / "dataset_info.json", [json.dumps(_SHAREGPT, indent=2).encode()])
            write_lines(folder / "train.yaml", [exporter.recipe().encode()])
        exporter.done.folder = out
        return exporter.done


class _Exporter:
    def __init__(
        self,
        reader: RunReader,
        out: Path,
        split: str,
        outcomes: frozenset[Outcome],
        progress: Callable[[int], object],
    ) -> None:
        self.done = Exported(out)
        self._reader = reader
        self._tasks = reader.tasks
        self._folder = out / PICTURES
        self._split = split
        self._leaking = leaking(list(self._tasks.values())) if split == "train" else {}
        self._default_split = reader.config.get("tasks", {}).get("split")
        self._outcomes = outcomes
        self._progress = progress
        self._written: set[str] = set()
        self._largest_picture = 0

    def _steps(self) -> Iterator[tuple[Task, Trajectory, Step]]:
        for number, trajectory in enumerate(self._reader.trajectories(), 1):
            self._progress(number)
            task = self._tasks[trajectory.episode.task_id]
            if task.id in self._leaking or self._split not in ("all", task.split or self._default_split):
                self.done.other_split += 1
            elif trajectory.outcome not in self._outcomes:
                self.done.unrewarded += 1
            else:
                self.done.attempts += 1
                self.done.policies.add(trajectory.episode.policy)
                for step in trajectory.episode.steps:
                    yield task, trajectory, step

    def rows(self) -> Iterator[dict[str, Any]]:
        """Rows with paths of pictures."""
        for task, trajectory, step in self._steps():
            self.done.steps += 1
            yield _row(task, trajectory, step) | {
                "images": [self._picture_path(ref) for ref in _refs(step.messages)]
            }

    def write_parquet(self, path: Path) -> None:
        """Write rows with the pictures themselves, in the form of the library ``datasets``."""
        with pq.ParquetWriter(path, _SCHEMA, compression="zstd") as writer:
            rows: list[dict[str, Any]] = []
            for task, trajectory, step in self._steps():
                self.done.steps += 1
                images = [{"bytes": self._sent(ref), "path": _name(ref)} for ref in _refs(step.messages)]
                self.done.pictures += len(images)
                rows.append(_row(task, trajectory, step) | {"images": images})
                if len(rows) == _ROWS:
                    writer.write_table(pa.Table.from_pylist(rows, _SCHEMA))
                    rows = []
            writer.write_table(pa.Table.from_pylist(rows, _SCHEMA))

    def conversations(self) -> Iterator[dict[str, Any]]:
        """A conversation for every step with an action, whose last message is the reply."""
        for _, _, step in self._steps():
            messages = [{"role": message.role, "content": _flat(message)} for message in step.messages]
            refs = _refs(step.messages)
            # A placeholder in the text of a page would shift all later pictures.
            texts = "\n".join([*(message["content"] for message in messages), step.reply.whole])
            others = any(placeholder in texts for placeholder in ("<video>", "<audio>"))
            if step.action is None or texts.count(_IMAGE) != len(refs) or others:
                self.done.unusable += 1
                continue
            self.done.steps += 1
            yield {
                "messages": [*messages, {"role": "assistant", "content": step.reply.whole}],
                "images": [self._picture_path(ref) for ref in refs],
            }

    def recipe(self) -> str:
        """Settings with which LLaMA-Factory trains on what the model saw: its defaults shrink the pictures,
        cut conversations off, and train on an empty thought."""
        policy = min(self.done.policies, default="")
        named = all_profiles().get(self._reader.config.get("agent", {}).get("profile") or "")
        profile = named or choose_profile(None, policy)
        most = getattr(profile.pictures, "max_pixels", 0)
        template = _TEMPLATES.get(profile.name)
        settings = {
            "model_name_or_path": policy,
            "stage": "sft",
            "do_train": True,
            "finetuning_type": "full",
            "dataset": "webgym",
            "dataset_dir": ".",
            "media_dir": ".",
            **({"template": template} if template else {}),
            "mask_history": True,
            "cutoff_len": 16384,
            "image_max_pixels": max(most, self._largest_picture),
            "output_dir": "trained",
            "bf16": True,
            **_PAPER,
        }
        notes = ["In this folder: llamafactory-cli train train.yaml"]
        if template is None:
            notes.append("Name your model's template, one without thinking if its replies have none.")
        if profile.grid == "pixels":
            notes.append("The replies point at pixels: a smaller image_max_pixels makes their points wrong.")
        return "".join(f"# {note}\n" for note in notes) + yaml.safe_dump(settings, sort_keys=False)

    def _sent(self, ref: ImageRef) -> bytes:
        data = self._reader.image(ref.screenshot)
        if hashlib.sha256(data).hexdigest() != ref.screenshot:
            raise StoreCorrupt(
                f"{self._reader.image_path(ref.screenshot)} is damaged", hint="webgym verify RUN names all"
            )
        return fit(data, (ref.width, ref.height))

    def _picture_path(self, ref: ImageRef) -> str:
        name = _name(ref)
        if name not in self._written:
            self._folder.mkdir(exist_ok=True)
            (self._folder / name).write_bytes(self._sent(ref))
            self._written.add(name)
            self._largest_picture = max(self._largest_picture, ref.width * ref.height)
            self.done.pictures += 1
        return f"{PICTURES}/{name}"


_SHAREGPT: Final = {
    "webgym": {
        "file_name": "sharegpt.json",
        "formatting": "sharegpt",
        "columns": {"messages": "messages", "images": "images"},
        "tags": {
            "role_tag": "role",
            "content_tag": "content",
            "user_tag": "user",
            "assistant_tag": "assistant",
            "system_tag": "system",
        },
    }
}
"""LLaMA-Factory's description of the file. Train with ``mask_history: true``: only the last reply of a
conversation is a target; earlier replies are targets in their own conversations."""
_TEMPLATES: Final = {
    "qwen3-vl": "qwen3_vl_nothink",
    "qwen3-vl-thinking": "qwen3_vl",
    "qwen2.5-vl": "qwen2_vl",
}
"""LLaMA-Factory's template for the models of a profile. One for thinking puts an empty thought before a reply
without any."""
_PAPER: Final = {
    "learning_rate": 1e-6,
    "lr_scheduler_type": "constant_with_warmup",
    "warmup_steps": 30,
    "weight_decay": 0.01,
    "max_grad_norm": 1.0,
    "num_train_epochs": 2,
    "per_device_train_batch_size": 1,
}
"""The paper's hyper-parameters (appendix F), where LLaMA-Factory has them."""


def _row(task: Task, trajectory: Trajectory, step: Step) -> dict[str, Any]:
    episode, outcome, reply, tokens = trajectory.episode, trajectory.outcome, step.reply, step.reply.tokens
    return {
        "attempt_id": episode.attempt_id,
        "task_id": task.id,
        "sample": episode.sample,
        "split": task.split,
        "level": task.level,
        "website": task.website,
        "instruction": task.instruction,
        "outcome": outcome.value,
        "reward": outcome.reward,
        "policy": reply.policy,
        "weight_version": reply.weight_version,
        "step": step.index,
        "steps": len(episode.steps),
        "messages": msgspec.json.encode(step.messages).decode(),
        "reply": reply.text,
        "reasoning": reply.reasoning,
        "action": msgspec.json.encode(step.action).decode() if step.action is not None else None,
        "parse_error": step.parse_error,
        "changed": step.changed,
        "prompt_ids": tokens.prompt_ids if tokens else None,
        "reply_ids": tokens.reply_ids if tokens else None,
        "reply_logprobs": tokens.reply_logprobs if tokens else None,
    }


def _refs(messages: tuple[Message, ...]) -> list[ImageRef]:
    return [part for message in messages for part in message.content if isinstance(part, ImageRef)]


def _flat(message: Message) -> str:
    return "".join(part.text if isinstance(part, TextPart) else _IMAGE for part in message.content)


def _name(ref: ImageRef) -> str:
    return f"{ref.screenshot}-{ref.width}x{ref.height}.png"


def _array(items: Iterator[Any]) -> Iterator[bytes]:
    """A JSON array, item by item."""
    before = b"[\n"
    for item in items:
        yield before + msgspec.json.encode(item)
        before = b",\n"
    yield b"[]\n" if before == b"[\n" else b"\n]\n"
