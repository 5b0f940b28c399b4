"""Plays the solutions of the offline web's tasks in Chromium, and appends every result to a file.

``webgym sites check`` uses it for all tasks of a version, so it does what the proof needs and nothing more:
pages, clicks, typing, navigation, the wait for a quiet page and the reading of visible text are those of an
agent's session, and the actions are parsed from replies. Left out is what no rule of the offline judge reads:
screenshots, prompts, and the record of a run. Browsers are driven without a server in between. A tab is used
for several tasks of a website, each time as a new visitor without cookies and history. Only a corner of it is
drawn, which keeps open lists from being scrolled; so a task that fails is played again in a fresh tab that is
drawn in full, and that counts.
"""

from __future__ import annotations

import asyncio
import fcntl
import hashlib
import random
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, nullcontext
from itertools import groupby
from pathlib import Path
from typing import Final, Self

import msgspec

from webgym.agent.agent import AgentTraits
from webgym.agent.parser import ParseError, parse_reply
from webgym.agent.prompts import render_reply
from webgym.agent.solver import Solver
from webgym.browser.config import BrowserConfig
from webgym.browser.find import find_browser
from webgym.browser.slot import Slot
from webgym.core.action import Action, Answer, BrowserAction, LeftClick, Mode, Scroll
from webgym.core.background import task_group
from webgym.core.errors import BrowserError, StoreCorrupt, StoreLocked, WebGymError
from webgym.core.observation import Observation, Probed
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Reply, Step, Trajectory
from webgym.judge.offline import OfflineJudge
from webgym.offline.app import SitesClient, serving
from webgym.offline.config import SitesConfig
from webgym.offline.proofs import repeating_pages, typed_proofs
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig
from webgym.rollout.driver import EpisodeContext, EpisodeDriver, NoStore
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress
from webgym.run.collect import Show
from webgym.run.services import ServedState
from webgym.server.config import ServerConfig
from webgym.server.messages import SessionOptions, View
from webgym.server.pool import Pool
from webgym.store.checksums import encode
from webgym.store.files import disk_errors
from webgym.testing.solutions import judged, may_be_cut_off

_TASKS_PER_TAB: Final = 12
"""Tasks of one website that a tab plays in a row; tasks derived from another stay with it."""

_SHOWN_CHARACTERS: Final = 600
"""Longest text of the last page in the result of a task that failed."""


class Result(msgspec.Struct, frozen=True, omit_defaults=True):
    """What came of playing one task.

    Attributes:
        task: its id.
        content: :func:`content_of` the task.
        browser: version of Chromium.
        mode: how the agent named its targets.
        outcome: of the attempt.
        steps: actions of the solution, with the answer.
        faults: a line for everything that is wrong; empty if the task passed.
        seen: if it failed: a line for every step, and the text of the last page.
        first_try: faults of a first try. The task was then played in a fresh tab, drawn in full, and that
            counts.
        begins: the task in whose attempt this one's was included: from a new visitor's first page on, its
            first actions were all those of this task's solution. Judged by itself, with the server's state at
            that point.
    """

    task: str
    content: str
    browser: str
    mode: Mode
    outcome: Outcome
    steps: int
    faults: tuple[str, ...] = ()
    seen: tuple[str, ...] = ()
    first_try: tuple[str, ...] = ()
    begins: str = ""


def content_of(task: Task) -> str:
    """A digest of everything about a task: instruction, rubric, truth and solution."""
    return hashlib.sha256(msgspec.json.encode(task)).hexdigest()[:16]


class ResultFile:
    """A file of results, one JSON line each; the last line about a task counts. Locked while it is open.

    A killed process loses no result: a line that was not completed is cut off, and its task played again.
    Files of several processes may be concatenated.

    Args:
        path: the file; created if it does not exist.

    Attributes:
        results: the results, by task id.

    Raises:
        StoreLocked: another process has opened it.
        StoreCorrupt: a complete line is no result.
        StoreError: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        with disk_errors(f"opening {path}"):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise StoreLocked(
                f"another process writes to {path}", hint="give each one its own file"
            ) from None
        self.results: dict[str, Result] = {}
        self._file.seek(0)
        end = 0
        for number, line in enumerate(self._file, 1):
            if not line.endswith(b"\n"):
                self._file.truncate(end)
                break
            end += len(line)
            try:
                result = msgspec.json.decode(line, type=Result)
            except msgspec.MsgspecError as error:
                self._file.close()
                raise StoreCorrupt(f"{path} line {number} is no result: {error}") from error
            self.results[result.task] = result

    def add(self, result: Result) -> None:
        """Append a result."""
        with disk_errors(f"writing {self._file.name}"):
            self._file.write(encode(result) + b"\n")
            self._file.flush()
        self.results[result.task] = result

    def of(self, task: Task, mode: Mode) -> Result | None:
        """The result of a task as it is now, in this mode; ``None`` if there is none."""
        result = self.results.get(task.id)
        is_valid = result is not None and (result.mode, result.content) == (mode, content_of(task))
        return result if is_valid else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._file.close()


async def check_in_browsers(
    web: OfflineWeb,
    tasks: Sequence[Task],
    file: Path,
    *,
    mode: Mode = "coordinates",
    sessions: int = 4,
    latency: float = 0.0,
    seed: int = 0,
    again: bool = False,
    show: Show | None = None,
    on_episode: Callable[[Task, Episode], None] | None = None,
) -> list[str]:
    """Play every task's solution in real browsers, except those of which the file has the result.

    Args:
        web: the websites; they are served here.
        tasks: on these websites.
        file: results are appended to it, see :class:`ResultFile`.
        mode: the agent's action mode.
        sessions: number of browsers.
        latency: factor on the simulated latency; 0 for none.
        seed: of the order, in which groups of tasks of one website are shuffled.
        again: whether tasks that failed are played again. Those that browser or websites failed always are.
        show: as for :func:`webgym.run.collect.collect`.
        on_episode: called with every episode that was played.

    Returns:
        A line for every task whose solution fails, whose evidence is truncated on the page or could be typed,
        or for which a degraded solution passes, including results that the file has.
    """
    with ResultFile(file) as results:
        missing = [
            task
            for task in tasks
            if (known := results.of(task, mode)) is None
            or (known.faults and (again or known.outcome.is_retried))
        ]
        progress = Progress(
            total=len(tasks),
            done=len(tasks) - len(missing),
            earlier=len(tasks) - len(missing),
            levels={task.id: task.level for task in tasks},
        )
        left = {task.id for task in missing}
        for task in tasks:
            if task.id not in left and (known := results.of(task, mode)) is not None:
                progress.outcomes[known.outcome] += 1
                progress.by_level[task.level, known.outcome] += 1
                progress.done_by_level[task.level] += 1
        if missing:
            context = (web, sessions, latency, mode, results, progress, on_episode)
            async with _playing(*context) as player, show(progress) if show else nullcontext():
                await player.play(_groups(missing, seed))
        found = (results.of(task, mode) for task in tasks)
        return list(dict.fromkeys(fault for result in found if result is not None for fault in result.faults))


def _groups(tasks: Sequence[Task], seed: int) -> list[list[Task]]:
    """The tasks in groups of one website, in random order; longer solutions come first in a group."""
    by_website: dict[str, list[Task]] = {}
    for task in tasks:
        by_website.setdefault(task.website, []).append(task)
    groups: list[list[Task]] = []
    for of_website in by_website.values():
        groups.append([])
        for _, family in groupby(of_website, lambda task: task.parent_id or task.id):
            if len(groups[-1]) >= _TASKS_PER_TAB:
                groups.append([])
            groups[-1] += family
    for group in groups:
        group.sort(key=_moves_of, reverse=True)
    random.Random(seed).shuffle(groups)
    return groups


def _moves_of(task: Task) -> int:
    assert task.truth is not None
    return len(task.truth.moves)


@asynccontextmanager
async def _playing(
    web: OfflineWeb,
    sessions: int,
    latency: float,
    mode: Mode,
    results: ResultFile,
    progress: Progress,
    on_episode: Callable[[Task, Episode], None] | None,
) -> AsyncIterator[_Player]:
    async with (
        serving(SitesConfig(latency=latency), web) as sites,
        SitesClient(sites.url, sites.token) as client,
    ):
        browser = BrowserConfig(freeze=False).allowing(*sites.allowed_hosts)
        executable = await asyncio.to_thread(find_browser)
        pool = Pool(ServerConfig(slots=sessions, browser=browser), executable.path)
        context = EpisodeContext(
            store=NoStore(),
            config=AttemptConfig(viewport=web.collection.viewport),
            site_state=ServedState(client),
            seed=0,
        )
        try:
            await pool.start()
            yield _Player(web, pool, sessions, context, mode, results, progress, on_episode)
        finally:
            await pool.stop()


class _Tab:
    """A browser session without pictures, on a slot of this process.

    Attributes:
        tasks: the tasks whose evidence is looked for among what pages cut off.
    """

    id = ""

    def __init__(self, slot: Slot) -> None:
        self._slot = slot
        self.tasks: Sequence[Task] = ()
        self._effects = 0
        """Number of clicks and scrolls that had an effect. It may be one that only a picture would show, such
        as the focus or a box that scrolled a little, or one out of view: the solver must not take the action
        for one without effect."""

    async def open(self, options: SessionOptions, *, is_plain: bool) -> None:
        """Begin, in a fresh tab that is drawn in full if it is plain."""
        if is_plain:
            await self._slot.open(options)
        elif self._slot.is_open:
            await self._slot.begin_again(options)
        else:
            await self._slot.open(options)
            await self._slot.page.draw_a_corner()

    async def step(self, action: BrowserAction | None = None) -> View:
        assert action is not None
        await self._slot.act(action)
        observation = await self._slot.observe_without_picture()
        if isinstance(action, LeftClick | Scroll):
            self._effects += all(notice.kind != "no_effect" for notice in observation.notices)
        cuts = observation.cuts
        if any(task.truth and may_be_cut_off(task.truth, observation) for task in self.tasks):
            cuts = (await self._slot.observe_without_picture(cuts=True)).cuts
        name = f"{observation.screenshot}-{self._effects}"
        return View(msgspec.structs.replace(observation, screenshot=name, cuts=cuts), b"")

    async def probe(self, url: str) -> Probed:
        return await self._slot.probe(url)

    async def close(self) -> None:
        await self._slot.close()


class _Player:
    """Plays groups of tasks and stores their results."""

    def __init__(
        self,
        web: OfflineWeb,
        pool: Pool,
        sessions: int,
        context: EpisodeContext,
        mode: Mode,
        results: ResultFile,
        progress: Progress,
        on_episode: Callable[[Task, Episode], None] | None,
    ) -> None:
        self._web = web
        self._pool = pool
        self._sessions = sessions
        self._context = context
        self._traits = AgentTraits("scripted", mode, elements=True)
        self._results = results
        self._progress = progress
        self._on_episode = on_episode
        self._judge = OfflineJudge()
        self._repeating: dict[str, list[str]] = {}

    async def play(self, groups: Sequence[Sequence[Task]]) -> None:
        """Play groups of tasks of one website each."""
        remaining = iter(groups)

        async def work() -> None:
            for group in remaining:
                await self._play_group(group)

        async with task_group() as workers:
            for _ in range(min(self._sessions, len(groups))):
                workers.create_task(work())

    async def _play_group(self, group: Sequence[Task]) -> None:
        slot = await self._pool.acquire()
        remaining = list(group)
        try:
            while remaining:
                task = remaining.pop(0)
                episode, included = await self._attempt(slot, task, 0, remaining)
                result = await self._result(task, episode)
                if result.faults:
                    episode, _ = await self._attempt(slot, task, 1)
                    result = await self._result(task, episode, first_try=result.faults)
                self._add(task, result, episode)
                for other, episode in included:
                    result = await self._result(other, episode, begins=task.id)
                    if not result.faults:  # else it gets an attempt of its own
                        self._add(other, result, episode)
                        remaining.remove(other)
        finally:
            await asyncio.shield(self._pool.clean(slot))
            self._pool.give_back(slot)

    def _add(self, task: Task, result: Result, episode: Episode) -> None:
        faults = (*result.faults, *self._typed(task))
        self._results.add(msgspec.structs.replace(result, faults=faults))
        self._progress.done += 1
        self._progress.done_by_level[task.level] += 1
        self._progress.ended(Trajectory(episode, result.outcome))

    def _typed(self, task: Task) -> Iterator[str]:
        """:func:`webgym.testing.solutions.typed` for one task; every website is searched once."""
        assert task.truth is not None
        yield from typed_proofs(task)
        for host in sorted(task.truth.hosts):
            if host not in self._repeating:
                site = self._web.website(host)
                assert site is not None
                self._repeating[host] = list(repeating_pages(site))
            yield from self._repeating[host]

    async def _attempt(
        self, slot: Slot, task: Task, retry: int, others: Sequence[Task] = ()
    ) -> tuple[Episode, list[tuple[Task, Episode]]]:
        """Play a task in a slot's tab.

        Args:
            slot: the slot.
            task: the task.
            retry: number of the try. The second is without shortcuts: in a fresh tab, drawn in full.
            others: further tasks of the website, which may end on the way.

        Returns:
            The episode, and the other tasks whose solutions had all their actions in common with the
            beginning of this one's, each with its episode.
        """
        driver = EpisodeDriver(self._context, Planned(task, 0, retry), self._traits)
        tab, solver = _Tab(slot), self._solver(task)
        candidates, included = (
            [(other, self._solver(other)) for other in others],
            list[tuple[Task, Episode]](),
        )
        self._progress.move(None, "acting", driver.planned.attempt_id)
        try:
            await tab.open(driver.options(), is_plain=retry > 0)
            tab.tasks = [task, *others]
            view: View | None = await driver.start(tab)
            while view is not None and not driver.is_over:
                index = len(driver.steps)
                step = self._step(solver, view.observation, index)
                steps = [
                    (other, ours, self._step(ours, view.observation, index)) for other, ours in candidates
                ]
                included += [
                    (other, await self._ended(other, driver, last))
                    for other, _, last in steps
                    if isinstance(last.action, Answer) and index < self._context.config.budget.for_task(other)
                ]
                candidates = [
                    (other, ours)
                    for other, ours, next_step in steps
                    if next_step.action == step.action and not isinstance(step.action, Answer)
                ]
                tab.tasks = [task, *(other for other, _ in candidates)]
                self._progress.stepped(driver.planned.attempt_id)
                view = await driver.take(step)
        except BrowserError as error:
            driver.fail(error)
            await slot.stop()  # a second try, or the next task, starts another browser
        except WebGymError as error:
            driver.fail(error)
        finally:
            self._progress.move("acting", None, driver.planned.attempt_id)
        await driver.conclude()
        episode = driver.episode()
        if self._on_episode is not None:
            self._on_episode(task, episode)
        return episode, included

    async def _ended(self, task: Task, driver: EpisodeDriver, answer: Step) -> Episode:
        """The episode of a task whose solution ends at this point of another's attempt, with an answer."""
        assert task.truth is not None
        assert isinstance(answer.action, Answer)
        assert self._context.site_state is not None
        state = None
        if any(fact.state for fact in task.truth.facts):
            state = await self._context.site_state.state(driver.visitor, task.truth.host)
        return msgspec.structs.replace(
            driver.episode(),
            attempt_id=Planned(task, 0).attempt_id,
            task_id=task.id,
            steps=(*driver.steps, answer),
            ending=Ending.ANSWERED,
            final=None,
            answer=answer.action.text,
            final_state=state,
        )

    def _solver(self, task: Task) -> Solver:
        assert task.truth is not None
        return Solver(task.website, task.truth.moves)

    def _step(self, solver: Solver, observation: Observation, index: int) -> Step:
        act = solver.next(observation, self._traits.mode)
        text = render_reply(act.action, "memory", description=act.description)
        return Step(index, observation, (), Reply(text, "scripted"), self._parsed(text))

    def _parsed(self, text: str) -> Action:
        parsed = parse_reply(text, self._traits.mode, "memory")
        if isinstance(parsed, ParseError):
            raise RuntimeError(f"the reply {text!r} cannot be read: {parsed}")
        return parsed.action

    async def _result(
        self, task: Task, episode: Episode, *, first_try: tuple[str, ...] = (), begins: str = ""
    ) -> Result:
        trajectory, faults = await judged(task, episode, self._judge)
        return Result(
            task=task.id,
            content=content_of(task),
            browser=self._pool.browser,
            mode=self._traits.mode,
            outcome=trajectory.outcome,
            steps=len(episode.steps),
            faults=tuple(faults),
            seen=tuple(_seen(episode)) if faults else (),
            first_try=first_try,
            begins=begins,
        )


def _seen(episode: Episode) -> Iterator[str]:
    for step in episode.steps:
        description = step.reply.text.partition("Action: ")[2].partition("\n")[0]
        yield f"{step.observation.url}: {description}"
    last = episode.observations[-1] if episode.observations else None
    if last is not None:
        yield f"{last.url} shows: {(last.text or '')[:_SHOWN_CHARACTERS]}"
