"""Validation of the offline web's tasks: the known solution must pass, and degraded versions of it must not.

``webgym sites check`` has the scripted policy play every solution in real browsers, as a run, and evaluates
the attempts with this module.
"""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import msgspec
from pydantic import SecretStr

from webgym.agent.config import AgentConfig
from webgym.browser.config import BrowserConfig
from webgym.core.action import Mode
from webgym.core.errors import JudgeError, RunFolderError
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import Task
from webgym.core.text import fold, says
from webgym.core.trajectory import Episode, Trajectory
from webgym.core.truth import Evidence, Truth
from webgym.judge.base import Judge, no_picture
from webgym.judge.offline import OfflineJudge
from webgym.offline.app import serving
from webgym.offline.config import SitesConfig
from webgym.offline.proofs import repeating_pages, typed_proofs
from webgym.offline.web import COLLECTIONS, OfflineWeb
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.run.collect import Show, collect, resume
from webgym.run.config import PolicyChoice, RunConfig, Secrets, ServerChoice, TaskChoice
from webgym.store.files import CONFIG
from webgym.store.runs import RunReader


class Checked(NamedTuple):
    """The result of a check of tasks.

    Attributes:
        tasks: ids of the tasks that were checked.
        failures: a line for each fault: the id of its task, or the address of its page, and the reason.
    """

    tasks: Sequence[str]
    failures: Sequence[str]

    def __str__(self) -> str:
        failed = {failure.partition(": ")[0] for failure in self.failures} & set(self.tasks)
        passed = f"{len(self.tasks) - len(failed)} of {len(self.tasks)} tasks passed"
        return "\n".join([*self.failures, passed])


async def check_in_browsers(
    web: OfflineWeb,
    tasks: Sequence[Task],
    run: Path,
    *,
    mode: Mode = "coordinates",
    sessions: int = 4,
    latency: float = 0.0,
    show: Show | None = None,
) -> list[str]:
    """Have the scripted policy play every task in real browsers, and check what came of it.

    Args:
        web: the websites; they are served here.
        tasks: on these websites.
        run: the run folder. One that holds a check of these tasks is resumed: what was played counts.
        mode: the agent's action mode.
        sessions: number of browsers.
        latency: factor on the simulated latency; 0 for none.
        show: as for :func:`webgym.run.collect.collect`.

    Returns:
        A line for every task whose solution fails, whose evidence is truncated on the page or could be typed,
        or for which a degraded solution passes.

    Raises:
        RunFolderError: the folder holds something else.
        WebGymError: browsers or websites failed.
    """
    shipped = (name for name, collection in COLLECTIONS.items() if collection is web.collection)
    made = SitesConfig(
        collection=next(shipped, "large"), seed=web.seed, per_family=web.per_family, latency=latency
    )
    async with serving(made, web) as sites:
        server = ServerChoice(sites_url=sites.url)
        secrets = Secrets(sites_token=SecretStr(sites.token))
        if (run / CONFIG).exists():
            if RunReader(run).drawn != list(tasks):
                raise RunFolderError(f"{run} holds a check of other tasks", hint="give another folder")
            await resume(run, secrets=secrets, server=server, show=show, tell=None)
        else:
            config = RunConfig(
                tasks=TaskChoice(split="all"),
                policy=PolicyChoice(name="scripted"),
                agent=AgentConfig(mode=mode),
                server=server,
                browser=BrowserConfig().allowing(*sites.allowed_hosts),
                sites=made,
                attempt=AttemptConfig(viewport=web.collection.viewport, record_cuts=True),
                collector=CollectorConfig(sessions=sessions, straggler_share=1.0),
            )
            await collect(config, run, tasks=tasks, secrets=secrets, show=show, tell=None)
    return await check_run(web, run)


async def check_run(web: OfflineWeb, run: Path) -> list[str]:
    """The faults of a run of the scripted policy, one line each; see :func:`check_in_browsers`."""
    reader, judge = RunReader(run), OfflineJudge()
    last = {entry.task_id: entry.attempt_id for entry in reader.attempts.values()}
    faults = [f"{task_id}: was not attempted" for task_id in reader.tasks if task_id not in last]
    for trajectory in reader.trajectories(last.values()):
        task = reader.tasks[trajectory.episode.task_id]
        faults += await faults_of(task, trajectory, judge)
    return list(dict.fromkeys([*faults, *typed(web, reader.drawn)]))


def unexpected(tasks: Mapping[str, Task], trajectories: Iterable[Trajectory]) -> Iterator[str]:
    """A line for every task whose solution did not end in the expected outcome, with the reason."""
    attempted: set[str] = set()
    for trajectory in trajectories:
        episode = trajectory.episode
        task = tasks[episode.task_id]
        assert task.truth is not None
        attempted.add(task.id)
        if trajectory.outcome != task.truth.expects:
            expected = f"expected {task.truth.expects}, got {trajectory.outcome}"
            yield f"{task.id}: {expected} after {len(episode.steps)} steps: {_why(trajectory)}"
    for task_id in tasks.keys() - attempted:
        yield f"{task_id}: was not attempted"


def typed(web: OfflineWeb, tasks: Iterable[Task]) -> Iterator[str]:
    """A line for every piece of evidence that an agent could produce by typing it, on these tasks'
    websites."""
    hosts: dict[str, None] = {}
    for task in tasks:
        assert task.truth is not None
        hosts |= dict.fromkeys(sorted(task.truth.hosts))
        yield from typed_proofs(task)
    for host in hosts:
        site = web.website(host)
        assert site is not None
        yield from repeating_pages(site)


def cut_off(tasks: Mapping[str, Task], trajectories: Iterable[Trajectory]) -> Iterator[str]:
    """A line for all evidence that a page truncates at every scroll position. Needs ``record_cuts``."""
    for trajectory in trajectories:
        task = tasks[trajectory.episode.task_id]
        assert task.truth is not None
        lines = {
            f'{task.id}: "{text}" is cut off on {url}, which shows "{shown}"'
            for fact in task.truth.facts
            for evidence in fact.evidence
            for url, text, shown in _cuts(task.truth, evidence, trajectory.episode)
        }
        yield from sorted(lines)


def _cuts(truth: Truth, evidence: Evidence, episode: Episode) -> Iterator[tuple[str, str, str]]:
    """Path, text and visible part of every line that truncates a text which is visible nowhere on the
    page."""
    pages: dict[str, tuple[list[str], set[tuple[str, str]]]] = {}
    for observation in episode.observations:
        address = urlsplit(observation.url)
        path = f"{address.path}?{address.query}" if address.query else address.path
        if address.hostname == (evidence.host or truth.host) and re.match(evidence.path, path):
            visible, cuts = pages.setdefault(path, ([], set()))
            visible.append(fold(observation.text or ""))
            cuts.update(observation.cuts)
    for path, (visible, cuts) in pages.items():
        for text in evidence.texts:
            if not any(says(page_text, text) for page_text in visible):
                for whole, shown in cuts:
                    if says(fold(whole), text) and not says(fold(shown), text):
                        yield path, text, shown


def _why(trajectory: Trajectory) -> str:
    episode, verdict = trajectory.episode, trajectory.verdict
    failure = episode.failure or trajectory.judge_failure
    if failure is not None:
        return failure.message
    if verdict is None:
        return "it was not judged"
    judgements = [verdict.reference, verdict.response, *(fact.judgement for fact in verdict.facts)]
    reasons = [
        judgement.reason for judgement in judgements if judgement is not None and judgement.passed is False
    ]
    return f"{'; '.join(reasons)} (answer: {episode.answer!r})"


def degraded_solutions(task: Task, solved: Episode) -> Iterator[tuple[str, Episode]]:
    """A successful episode, degraded in every way that must make it fail.

    Yields:
        What was changed, and the degraded episode.
    """
    change = msgspec.structs.replace
    assert task.truth is not None
    if task.truth.answer.required:
        yield "a wrong answer", change(solved, answer="It is the other one, 987654321.")
        yield "an answer that gives up", change(solved, answer="I could not find it.")
        if task.truth.answer.others:
            wrong = f"{solved.answer}\n{task.truth.answer.others[0]}"
            yield "an answer that names another candidate too", change(solved, answer=wrong)
    yield "no answer", change(solved, answer=None, ending=Ending.BUDGET_SPENT)
    yield "a right answer at first sight", change(solved, steps=solved.steps[:1], final=None)
    yield "a right answer without an observation", change(solved, steps=(), final=None)
    nothing = change(solved, steps=(), final=None, answer=None, ending=Ending.BUDGET_SPENT, final_state={})
    yield "an empty trajectory", nothing
    if any(fact.state for fact in task.truth.facts):
        yield "nothing done on the server", change(solved, final_state={})


async def faults_of(task: Task, trajectory: Trajectory, judge: Judge) -> list[str]:
    """A line for everything that is wrong with a task or its solution, which was carried out: another outcome
    than expected, evidence that a page truncates, degraded solutions that pass."""
    tasks = {task.id: task}
    faults = [*unexpected(tasks, [trajectory]), *cut_off(tasks, [trajectory])]
    return faults + [line async for line in wrongly_accepted(tasks, [trajectory], judge)]


async def wrongly_accepted(
    tasks: Mapping[str, Task], trajectories: Iterable[Trajectory], judge: Judge
) -> AsyncIterator[str]:
    """A line for every degraded solution that the judge accepts."""
    for trajectory in trajectories:
        if trajectory.outcome is not Outcome.SUCCESS:
            continue
        task = tasks[trajectory.episode.task_id]
        for what, episode in degraded_solutions(task, trajectory.episode):
            try:
                verdict = await judge.judge(task, episode, no_picture)
            except JudgeError:
                continue
            if verdict.reward == 1:
                yield f"{task.id}: {what} passes"
