"""The conditions of an evaluation, to publish with its results so that others can repeat it.

Everything is read from the run folder. What the run does not record is ``None``.
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

from webgym.core.identity import Identity
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Failure, Step, TextPart, Trajectory
from webgym.core.verdict import Verdict
from webgym.core.websites import host_or_text
from webgym.store.files import TASKS
from webgym.store.runs import RunReader
from webgym.tasks.hub import address_of
from webgym.tasks.selection import splits_in

VARIES: Final = "varies"
_MOST_VALUES: Final = 3
"""Most values of a sampling parameter that are listed; with more, as for seeds, it is ``varies``."""


class Manifest(msgspec.Struct, frozen=True):
    """The conditions of an evaluation; ``None`` for what the run does not record.

    Attributes:
        run: name of its folder.
        webgym: version that collected it.
        began, ended: start of the first and end of the last attempt, ISO 8601, UTC.
        task_file: name of the task file; ``None`` also for tasks that the caller of :func:`webgym.collect`
            drew, and for those of the offline web. Of a data set of the hub, its address with the commit.
        benchmark: whose public file it is.
        offline_web: collection, seed and size, if tasks are of the offline web.
        sources: number of tasks by the benchmark that they come from.
        split: of the tasks, as they record it.
        tasks_sha256: digest of the run's ``tasks.jsonl``, which lists the tasks in order.
        left_out: number of tasks excluded from the draw, by reason.
        seed: of the order of tasks and of all random choices in the attempts.
        samples: planned per task.
        budget: steps by level.
        policies: names, as the attempts record them.
        weights: versions of the policy's weights.
        sampling: parameters of the requests, with every value that was used, or ``varies``.
        agent: prompt format, mode, actions, profile, and number of rounds in the history.
        prompts: SHA-256 of the system messages that were sent.
        judges: names and versions of the judges; a rubric judge's version is that of its rules and prompts,
            with the model and a digest of its settings.
        judge_prompts: SHA-256 of the prompts of the judges that ask a model, by name.
        browser: product and version at the start of the run.
        sandboxed: whether Chromium's sandbox was on.
        without: what did not hold because the browser was a remote one, a line each.
        identity: what was set of who the browser says that it is, for the run; tasks may set more.
        routes: attempts by the upstream proxy of the last page, or ``direct``; ``None`` if there were none.
        viewport: width and height, CSS pixels.
        server: ``here``, ``elsewhere``, or ``static`` for small websites without browsers.
        egress: what pages could connect to: rules, ports, connections per second, and the names of upstream
            proxies. A server elsewhere
            reports them when the run begins; ``None`` if it is too old to.
        attempts: number of all attempts, including repeated ones.
        planned: number of samples of all tasks.
        judged: samples that ended with a reward.
        successes: successful samples.
        invalid: samples without a reward, by outcome and error code (``""`` if there was no error).
        missing: samples that have not ended or have not been judged.
        blocked_websites: blocked samples by website.
    """

    run: str
    webgym: str | None
    began: str | None
    ended: str | None
    task_file: str | None
    benchmark: str | None
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
    judge_prompts: dict[str, str] | None
    browser: str | None
    sandboxed: bool | None
    without: list[str] | None
    identity: dict[str, Any]
    routes: dict[str, int] | None
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
    """Collects from a run's attempts what the manifest reports about them."""

    policies: dict[str, None] = field(default_factory=dict)
    judges: dict[str, str] = field(default_factory=dict)
    """Judges with the digests of their prompts."""
    weights: dict[str, None] = field(default_factory=dict)
    prompts: dict[str, None] = field(default_factory=dict)
    sampling: dict[str, list[Any]] = field(default_factory=dict)
    began: float | None = None
    ended: float | None = None
    invalid: dict[str, Counter[str]] = field(default_factory=dict)
    blocked: Counter[str] = field(default_factory=Counter)
    routes: Counter[str] = field(default_factory=Counter)
    left_out: list[str] = field(default_factory=list)
    """A line for each kind of records that are in no figure."""

    def add(
        self,
        trajectory: Trajectory,
        outcome: Outcome,
        failure: Failure | None,
        verdict: Verdict | None,
        website: str,
    ) -> None:
        """Add the attempt that counts for a sample.

        Args:
            trajectory: its record.
            outcome: according to the judge whose verdicts count.
            failure: the error that prevented a reward, if any.
            verdict: of that judge, if any.
            website: of its task.
        """
        episode = trajectory.episode
        self.policies.setdefault(episode.policy)
        if verdict is not None:
            self.judges.setdefault(verdict.judge, verdict.prompts)
        ended = episode.started_at + episode.seconds
        self.began = episode.started_at if self.began is None else min(self.began, episode.started_at)
        self.ended = ended if self.ended is None else max(self.ended, ended)
        for step in episode.steps:
            self._add_step(step)
        if not outcome.is_rewarded:
            self.invalid.setdefault(outcome.value, Counter())[failure.code if failure else ""] += 1
        seen = trajectory.episode.observations
        if seen and seen[-1].route:
            self.routes[seen[-1].route] += 1
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


@functools.lru_cache(maxsize=64)  # most steps of a run have the same system message
def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def manifest_of(
    reader: RunReader, records: Records, judge: str | None, counted: Mapping[str, int]
) -> Manifest:
    """The manifest of a run.

    Args:
        reader: of the run.
        records: collected from its attempts.
        judge: the judge whose verdicts count, if not the recorded ones.
        counted: ``planned``, ``judged``, ``successes`` and ``missing`` samples.
    """
    config = reader.config
    software, server, agent = (_part(config, name) for name in ("software", "server", "agent"))
    attempt, tasks = _part(config, "attempt"), _part(config, "tasks")
    file = tasks.get("file")
    server_location = None
    if server:
        server_location = "static" if server.get("static") else "elsewhere" if server.get("url") else "here"
    return Manifest(
        run=reader.path.resolve().name,
        webgym=software.get("webgym"),
        began=_iso_time(records.began),
        ended=_iso_time(records.ended),
        task_file=(str(file) if address_of(str(file)) else str(file).rpartition("/")[2]) if file else None,
        benchmark=tasks.get("benchmark"),
        offline_web=_offline_web(reader, config),
        sources=dict(Counter(task.source for task in reader.drawn).most_common()),
        split=splits_in(reader.drawn),
        tasks_sha256=hashlib.sha256((reader.path / TASKS).read_bytes()).hexdigest(),
        left_out=config.get("left_out_tasks"),
        seed=config.get("seed"),
        samples=reader.samples,
        budget=(
            (attempt["budget_easy"], attempt["budget_medium"], attempt["budget_hard"]) if attempt else None
        ),
        policies=list(records.policies),
        weights=list(records.weights) or None,
        sampling=_sampling(records) or None,
        agent={name: agent.get(name) for name in _AGENT} if agent else None,
        prompts=list(records.prompts) or None,
        judges=[judge] if judge else list(records.judges),
        judge_prompts={name: digest for name, digest in records.judges.items() if digest} or None,
        browser=software.get("browser"),
        sandboxed=software.get("sandboxed"),
        without=software.get("without"),
        identity=_identity(config),
        routes=dict(records.routes.most_common()) or None,
        viewport=tuple(attempt["viewport"]) if attempt.get("viewport") else None,
        server=server_location,
        egress=_egress(config, server_location),
        attempts=len(reader.attempts),
        invalid={name: dict(codes.most_common()) for name, codes in records.invalid.items()},
        blocked_websites=dict(records.blocked.most_common()),
        **counted,
    )


_AGENT: Final = ("prompt_format", "mode", "actions", "profile", "rounds")


def _part(config: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A mapping in the config; empty if it is missing, as in runs that other programs wrote."""
    part = config.get(name)
    return part if isinstance(part, dict) else {}


def _iso_time(seconds: float | None) -> str | None:
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def _sampling(records: Records) -> dict[str, Any]:
    def summarised(values: list[Any]) -> Any:
        return VARIES if len(values) > _MOST_VALUES else values[0] if len(values) == 1 else values

    return {name: summarised(values) for name, values in sorted(records.sampling.items())}


def _offline_web(reader: RunReader, config: Mapping[str, Any]) -> dict[str, Any] | None:
    sites = _part(config, "sites")
    if not sites or not any(task.truth for task in reader.drawn):
        return None
    return {name: sites.get(name) for name in ("collection", "seed", "per_family", "latency")}


def _identity(config: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that differ from the usual identity, the run's over the server's."""
    parts = (_part(_part(config, name), "identity") for name in ("browser", "attempt"))
    usual = Identity().model_dump(mode="json")
    fields = {name: value for part in parts for name, value in part.items() if value != usual.get(name)}
    return {name: value for name, value in fields.items() if name not in ("credentials", "headers")}


def _egress(config: Mapping[str, Any], server_location: str | None) -> dict[str, Any] | None:
    places = {"here": "browser", "elsewhere": "software"}
    egress = _part(_part(config, places.get(server_location or "", "")), "egress")
    if not egress:
        return None
    upstream = list(egress.get("upstream") or ())
    return {name: egress.get(name) for name in ("allow", "ports", "rate")} | {"upstream": upstream}
