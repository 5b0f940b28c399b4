"""What an evaluation must be published with, so that others can repeat it.

Everything here is read from the run folder. What the run does not record is ``None``, never a guess.
"""

from __future__ import annotations

import functools
import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import msgspec

from webgym.core.outcome import Outcome
from webgym.core.trajectory import Failure, Step, TextPart, Trajectory
from webgym.core.websites import host_or_text
from webgym.rollout.files import TASKS
from webgym.rollout.store import RunReader
from webgym.tasks.selection import splits_in

VARIES: Final = "varies"
_MOST_VALUES: Final = 3
"""Values of one sampling parameter that are listed; more of them, as of seeds, vary."""


class Manifest(msgspec.Struct, frozen=True):
    """The conditions of an evaluation; ``None`` is what the run does not record.

    Attributes:
        run: name of its folder.
        webgym: version that collected it.
        began, ended: of the first and of the last attempt, ISO 8601, UTC.
        task_file: name of the task file; ``None`` also for tasks that the caller of :func:`webgym.collect`
            drew, and for those of the offline web.
        offline_web: collection, seed and size, if tasks are of the offline web.
        sources: tasks by the benchmark that they come from.
        split: that the tasks say they are of.
        tasks_sha256: of the run's ``tasks.jsonl``: equal digests, equal tasks in the same order.
        left_out: tasks of the set that were not drawn from, by reason.
        seed: of the order of tasks and of everything random in the attempts.
        samples: planned per task.
        budget: steps by level.
        policies: names, as the attempts record them.
        weights: versions of the weights that replied.
        sampling: parameters of the requests, with every value that was used, or ``varies``.
        agent: prompt format, mode, actions, profile and rounds that were shown.
        prompts: SHA-256 of the system messages that were sent.
        judges: name and version of who judged; of a rubric judge the version is that of its rules and
            prompts, with the model and a digest of its settings.
        browser: product and version when the run began.
        sandboxed: whether Chromium's sandbox was on.
        viewport: width and height, CSS pixels.
        server: ``here``, ``elsewhere``, or ``static`` for small websites without browsers.
        egress: what pages could connect to: rules, ports, connections per second; of a server elsewhere only
            it knows.
        attempts: all that were made, those at the same sample included.
        planned: samples of all tasks.
        judged: samples that ended with a reward.
        successes: of them.
        invalid: samples without a reward, by outcome and the code of the error (``""`` where there was none).
        missing: samples that have not ended, or not been judged.
        blocked_websites: samples by the website that kept the agent out.
    """

    run: str
    webgym: str | None
    began: str | None
    ended: str | None
    task_file: str | None
    offline_web: dict[str, Any] | None
    sources: dict[str, int]
    split: str
    tasks_sha256: str
    left_out: dict[str, int] | None
    seed: int | None
    samples: int
    budget: tuple[int, int, int] | None
    policies: list[str]
    weights: list[str] | None
    sampling: dict[str, Any] | None
    agent: dict[str, Any] | None
    prompts: list[str] | None
    judges: list[str]
    browser: str | None
    sandboxed: bool | None
    viewport: tuple[int, int] | None
    server: str | None
    egress: dict[str, Any] | None
    attempts: int
    planned: int
    judged: int
    successes: int
    invalid: dict[str, dict[str, int]]
    missing: int
    blocked_websites: dict[str, int]


@dataclass
class Records:
    """What the attempts of a run say about how they were made; they are read once."""

    policies: dict[str, None] = field(default_factory=dict)
    judges: dict[str, None] = field(default_factory=dict)
    weights: dict[str, None] = field(default_factory=dict)
    prompts: dict[str, None] = field(default_factory=dict)
    sampling: dict[str, list[Any]] = field(default_factory=dict)
    began: float | None = None
    ended: float | None = None
    invalid: dict[str, Counter[str]] = field(default_factory=dict)
    blocked: Counter[str] = field(default_factory=Counter)

    def add(self, trajectory: Trajectory, outcome: Outcome, failure: Failure | None, website: str) -> None:
        """Take note of the attempt that counts for a sample.

        Args:
            trajectory: its record.
            outcome: by the judge whose verdicts count.
            failure: what kept the reward from being.
            website: of its task.
        """
        episode = trajectory.episode
        self.policies.setdefault(episode.policy)
        if trajectory.verdict is not None:
            self.judges.setdefault(trajectory.verdict.judge)
        ended = episode.started_at + episode.seconds
        self.began = episode.started_at if self.began is None else min(self.began, episode.started_at)
        self.ended = ended if self.ended is None else max(self.ended, ended)
        for step in episode.steps:
            self._add_step(step)
        if not outcome.is_rewarded:
            self.invalid.setdefault(outcome.value, Counter())[failure.code if failure else ""] += 1
        if outcome is Outcome.BLOCKED:
            self.blocked[host_or_text(website)] += 1

    def _add_step(self, step: Step) -> None:
        reply = step.reply
        if reply.weight_version:
            self.weights.setdefault(reply.weight_version)
        for name, value in reply.sampling.items():
            values = self.sampling.setdefault(name, [])
            if len(values) <= _MOST_VALUES and value not in values:
                values.append(value)
        for message in step.messages:
            if message.role == "system":
                text = "".join(part.text for part in message.content if isinstance(part, TextPart))
                self.prompts.setdefault(_digest(text))


@functools.lru_cache(maxsize=64)  # every step of a run has the same one
def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def manifest_of(
    reader: RunReader, records: Records, judge: str | None, counted: Mapping[str, int]
) -> Manifest:
    """The manifest of a run.

    Args:
        reader: of the run.
        records: of its attempts.
        judge: whose verdicts count, if not those that the attempts record.
        counted: ``planned``, ``judged``, ``successes`` and ``missing`` samples.
    """
    config = reader.config
    software, server, agent = (_part(config, name) for name in ("software", "server", "agent"))
    attempt, tasks = _part(config, "attempt"), _part(config, "tasks")
    file = tasks.get("file")
    where = None
    if server:
        where = "static" if server.get("static") else "elsewhere" if server.get("url") else "here"
    return Manifest(
        run=reader.path.resolve().name,
        webgym=software.get("webgym"),
        began=_moment(records.began),
        ended=_moment(records.ended),
        task_file=str(file).rpartition("/")[2] if file else None,
        offline_web=_offline_web(reader, config),
        sources=dict(Counter(task.source for task in reader.drawn).most_common()),
        split=splits_in(reader.drawn),
        tasks_sha256=hashlib.sha256((reader.path / TASKS).read_bytes()).hexdigest(),
        left_out=config.get("left_out_tasks"),
        seed=config.get("seed"),
        samples=int(config.get("samples") or 1),
        budget=(
            (attempt["budget_easy"], attempt["budget_medium"], attempt["budget_hard"]) if attempt else None
        ),
        policies=list(records.policies),
        weights=list(records.weights) or None,
        sampling=_sampling(records) or None,
        agent={name: agent.get(name) for name in _AGENT} if agent else None,
        prompts=list(records.prompts) or None,
        judges=[judge] if judge else list(records.judges),
        browser=software.get("browser"),
        sandboxed=software.get("sandboxed"),
        viewport=tuple(attempt["viewport"]) if attempt.get("viewport") else None,
        server=where,
        egress=_egress(config) if where == "here" else None,
        attempts=len(reader.attempts),
        invalid={name: dict(codes.most_common()) for name, codes in records.invalid.items()},
        blocked_websites=dict(records.blocked.most_common()),
        **counted,
    )


_AGENT: Final = ("prompt_format", "mode", "actions", "profile", "rounds")


def _part(config: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A mapping in the config; empty where the run has none, as one that other programs wrote."""
    part = config.get(name)
    return part if isinstance(part, dict) else {}


def _moment(seconds: float | None) -> str | None:
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def _sampling(records: Records) -> dict[str, Any]:
    def told(values: list[Any]) -> Any:
        return VARIES if len(values) > _MOST_VALUES else values[0] if len(values) == 1 else values

    return {name: told(values) for name, values in sorted(records.sampling.items())}


def _offline_web(reader: RunReader, config: Mapping[str, Any]) -> dict[str, Any] | None:
    sites = _part(config, "sites")
    if not sites or not any(task.truth for task in reader.drawn):
        return None
    return {name: sites.get(name) for name in ("collection", "seed", "per_family", "latency")}


def _egress(config: Mapping[str, Any]) -> dict[str, Any] | None:
    egress = _part(_part(config, "browser"), "egress")
    return {name: egress.get(name) for name in ("allow", "ports", "rate")} if egress else None
