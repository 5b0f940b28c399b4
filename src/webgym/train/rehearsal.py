"""``webgym train --check``: all that a training needs is loaded and tried once, before hours depend on it.

What is found is told line by line; the first part that does not work raises what the training itself would.
"""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import torch
from accelerate.utils import broadcast_object_list

from webgym.agent.agent import Agent
from webgym.core.calls import call_queues
from webgym.core.errors import NavigationFailed, TrainingError
from webgym.core.task import Task
from webgym.core.trajectory import Step
from webgym.judge.factory import name_of
from webgym.rollout.driver import Browsers, EpisodeContext, EpisodeDriver, NoStore
from webgym.rollout.plan import Planned
from webgym.run.config import Secrets, Tell
from webgym.run.services import open_services
from webgym.server.client import BrowserClient
from webgym.server.messages import View
from webgym.store.files import disk_errors
from webgym.tasks.sampling import Sampler
from webgym.train.estimate import GIB
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.objectives import make_objective
from webgym.train.samples import SampleMaker
from webgym.train.start import Loaded, loaded
from webgym.train.update import Learner

_START_PAGES = 3
"""How many tasks' start pages are tried: a website may be down, or keep this machine out."""


async def rehearse(config: TrainConfig, out: Path, *, resume: bool, secrets: Secrets, tell: Tell) -> None:
    """Load everything, open a page, ask for a reply to it, and take an optimizer step on that.

    The new weights are dropped.

    Args:
        config: of the training; for a resumed one, the result of :func:`webgym.train.start.read_config`.
        out: the training's folder. Nothing is written to it but the log of a server.
        resume: whether it holds the training.
        secrets: tokens of servers that run elsewhere.
        tell: called with each line.

    Raises:
        WebGymError: the training could not start, or go on.
    """
    async with loaded(config, out, resume=resume, secrets=secrets, tell=tell, always_check=True) as found:
        folder, config = TrainingFolder(out), found.training.config
        splits = [task.split for task in found.tasks]
        tell(f"tasks      {splits.count('train'):,} to train on, {splits.count('test'):,} to test on")
        tell(f"folder     {_written(out)}")
        if (latest := folder.latest_weights()) is not None:
            await found.serving.publish(latest[1], str(latest[0]))
            tell(f"weights    of iteration {latest[0]} are served, and pass the self-test")
        judge = config.rollout.judge
        model = f", {judge.rubric.chat.model} replies" if judge.name == "rubric" and judge.rubric else ""
        tell(f"judge      {name_of(judge)}{model}")
        step, image = await _first_step(found, tell)
        tell(f"update     {await asyncio.to_thread(try_update, found.learner, config, folder, step, image)}")


def join_rehearsal(config: TrainConfig, out: Path) -> None:
    """Take the optimizer step together with the first process of a launch.

    Raises:
        TrainingError: as in the first process.
    """
    learner = Learner(config.learn, make_objective(config.learn.objective))
    try_update(learner, config, TrainingFolder(out))


def try_update(
    learner: Learner,
    config: TrainConfig,
    folder: TrainingFolder,
    step: Step | None = None,
    image: bytes = b"",
) -> str:
    """Take an optimizer step in all processes of a launch, with a whole micro-batch in each.

    Args:
        learner: of this process. Its weights are others afterwards.
        config: of the training.
        folder: of the training, with weights if it is resumed.
        step: in the first process: what is trained on.
        image: its screenshot.

    Returns:
        How long it took, and how much memory.

    Raises:
        TrainingError: the step cannot be trained on.
    """
    updater, update = learner.updater(folder), config.learn.update
    shared = [(step, image)]
    broadcast_object_list(shared)
    step, image = shared[0]
    assert step is not None
    off_policy = make_objective(config.learn.objective).off_policy
    maker = SampleMaker(updater.renderer, cutoff_tokens=update.cutoff_tokens, off_policy=off_policy)
    samples = list(maker.make([(step, 1.0)], lambda _name: image))
    if not samples:
        raise TrainingError(
            f"the policy's replies cannot be trained on: {', '.join(maker.dropped)}",
            hint="docs/training.md has the token contract",
        )
    processes = updater.accelerator.num_processes
    report = updater.update(samples * update.micro_batch * processes)
    memory = ""
    if torch.cuda.is_available():
        memory = f", {torch.cuda.max_memory_allocated() / GIB:.1f} GiB of the first GPU at most"
    tokens = "stored token ids" if maker.stored else "token ids made from texts"
    return (
        f"{report.samples} steps of {len(samples[0]):,} tokens ({tokens}) on {processes} processes in "
        f"{report.seconds:.1f} s, loss {report.loss:.3f}{memory}"
    )


def _written(out: Path) -> str:
    """Where the folder is and how much space it has, found by writing there.

    Raises:
        StoreError: it cannot be written to.
    """
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    with disk_errors(f"writing to {there}"), tempfile.TemporaryFile(dir=there) as file:
        file.write(bytes(2**20))
        file.flush()
    return f"{out} can be written, {shutil.disk_usage(there).free / GIB:.0f} GiB are free"


async def _first_step(found: Loaded, tell: Tell) -> tuple[Step, bytes]:
    """The policy's first step at a training task in a real session, and its screenshot."""
    config = found.training.config
    rollout = config.rollout.model_copy(update={"server": found.where})
    tasks = Sampler(found.tasks, config.sampler.model_copy(update={"seed": config.seed})).draw(_START_PAGES)
    agent = Agent(found.serving.policy, rollout.agent)
    calls = call_queues(rollout.limits.calls)
    async with open_services(rollout, found.secrets, tasks, tell, calls) as (site_state, browsers):
        if isinstance(browsers, BrowserClient):
            info = await browsers.info()
            sandbox = "on" if info.sandboxed else f"OFF: {info.sandbox_reason}"
            tell(f"browsers   {info.slots} slots at {rollout.server.url}, {info.browser}, sandbox {sandbox}")
        context = EpisodeContext(
            store=NoStore(), config=rollout.attempt, site_state=site_state, seed=config.seed
        )
        task, view = await _open_one(agent, context, tasks, browsers)
        step = await agent.begin(task, config.seed, 1).turn(view.observation, view.image, 0.0)
    width, height = view.observation.viewport
    tell(f"page       {view.observation.url}, {width} x {height}, opened")
    said = f"{type(step.action).__name__}" if step.action is not None else f"no action: {step.parse_error}"
    tell(f"policy     {found.serving.policy.name} replies in {step.reply.seconds or 0.0:.1f} s: {said}")
    return step, view.image


async def _open_one(
    agent: Agent, context: EpisodeContext, tasks: Sequence[Task], browsers: Browsers
) -> tuple[Task, View]:
    """The first of these tasks whose start page opens, and that page.

    Raises:
        NavigationFailed: none does.
        WebGymError: there is no session, or the offline web does not answer.
    """
    for task in tasks:
        driver = EpisodeDriver(context, Planned(task, 0), agent.traits)
        await driver.reach_site_state()
        session = await browsers.open(driver.options())
        try:
            return task, await driver.start(session)
        except NavigationFailed:
            if task is tasks[-1]:
                raise
        finally:
            await session.close()
    raise AssertionError("there is a task")
