"""Sets up a training: tasks, browsers, the collecting and the learning model.

The other processes of a launch on several GPUs only run updates: the drawn steps of an iteration are on disk
before its update starts, so they wait for that file and train on the same steps in the same order.
"""

from __future__ import annotations

import asyncio
import os
import time
import warnings
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import yaml

from webgym.agent.agent import Agent
from webgym.agent.preflight import check_policy
from webgym.agent.profiles import choose_profile
from webgym.core.consent import confirm
from webgym.core.errors import ConfigError, RunFolderError, TrainingError
from webgym.core.settings import load_settings, merged, validated
from webgym.core.task import Task
from webgym.inference.local import LocalConfig
from webgym.inference.model import load_renderer
from webgym.inference.vllm import serving_model
from webgym.judge.factory import check_judge, refuse_unjudgeable
from webgym.llm.config import altering
from webgym.rollout.trackers import tracking
from webgym.run.choice import all_tasks
from webgym.run.config import RunConfig, Secrets, ServerChoice, resolved
from webgym.run.services import services
from webgym.store.files import CONFIG, TASKS, refuse_special_files
from webgym.store.runs import RunReader
from webgym.tasks.split import refuse_leaks
from webgym.train.config import ReplayConfig
from webgym.train.engine_fleet import EngineFleet
from webgym.train.engine_serving import LOG, EngineServing
from webgym.train.estimate import estimate, present_gpus
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.loop import Show, Tell, TrainConfig, Training
from webgym.train.objectives import FilteredBC, Objective, PolicyGradient, make_objective
from webgym.train.placing import placed, waiting
from webgym.train.replay import Replay
from webgym.train.samples import Sample, SampleMaker
from webgym.train.serving import LocalServing, Serving
from webgym.train.stopping import Stop
from webgym.train.update import Learner, Updater
from webgym.train.weights import check_targets

JUDGE_LOG: Final = "judge.log"


class Loaded(NamedTuple):
    """A training with its models, judge and browsers, which has not begun.

    Attributes:
        training: itself.
        tasks: all of its tasks.
        serving: serves the policy.
        learner: trains the weights.
        where: the browsers.
        secrets: of those.
        lock: is left after everything else.
    """

    training: Training
    tasks: Sequence[Task]
    serving: Serving
    learner: Learner
    where: ServerChoice
    secrets: Secrets
    lock: ExitStack


@asynccontextmanager
async def open_training(
    config: TrainConfig,
    out: Path,
    *,
    resume: bool = False,
    secrets: Secrets | None = None,
    show: Show | None = None,
    tell: Tell | None = None,
    stop: Stop | None = None,
) -> AsyncIterator[Training]:
    """Open a training, with browsers and models started.

    Args:
        config: of the training; for a resumed one, the result of :func:`read_config`.
        out: the training's folder; missing or empty, unless it is resumed.
        resume: continue the training in the folder.
        secrets: tokens of servers that run elsewhere.
        show: shows the progress of each run.
        tell: called with each line that the user should read, such as a warning.
        stop: ends the training in time.

    Raises:
        WebGymError: the training cannot start.
    """
    folder = TrainingFolder(out)
    async with loaded(config, out, resume=resume, secrets=secrets, show=show, tell=tell, stop=stop) as found:
        training = found.training
        config = training.config
        if not resume:
            folder.create(config.model_dump(mode="json", exclude={"rollout": {"sites": {"token"}}}))
            found.lock.enter_context(folder.locked())
        rows, failed = folder.write_metrics(), warn_by(tell)
        with tracking(config.trackers, folder.path, config.project, rows, failed) as track:
            training.use(found.where, found.secrets, track)
            yield training


def warn_by(tell: Tell | None) -> Tell:
    """What tells a warning: ``tell``, else Python's warnings."""
    return tell or (lambda line: warnings.warn(line, stacklevel=1))


@asynccontextmanager
async def loaded(
    config: TrainConfig,
    out: Path,
    *,
    resume: bool = False,
    secrets: Secrets | None = None,
    show: Show | None = None,
    tell: Tell | None = None,
    stop: Stop | None = None,
    always_check: bool = False,
) -> AsyncIterator[Loaded]:
    """Load everything that a training needs; no folder is made.

    Args:
        config, out, resume, secrets, show, tell, stop: as for :func:`open_training`.
        always_check: request replies of policy and judge although ``rollout.policy.check`` is false, or the
            training is resumed.

    Raises:
        WebGymError: the training cannot start.
    """
    folder = TrainingFolder(out)
    if not resume:
        folder.refuse_used()
    if config.rollout.collector.sharing.folder is not None:
        raise ConfigError(
            "a training shares no tasks: rollout.collector.sharing.folder is for one run",
            hint="leave it out; each evaluation and iteration has tasks of its own",
        )
    await asyncio.to_thread(load_renderer, config.learn.model)  # before tasks are made, which takes longer
    tasks = all_tasks(config.rollout, tell)
    objective = make_objective(config.learn.objective)
    compares = isinstance(objective, PolicyGradient) and objective.baseline != "none"
    if compares and config.rollout.samples == 1:
        raise ConfigError(
            f"{config.learn.objective.name} compares attempts at the same task, and rollout.samples is 1",
            hint="set rollout.samples to 2 or more; configs/train/group-is.yaml has 8",
        )
    _refuse_unusable_replies(config, objective)
    here, judging, gpus_of_judge = placed(config)
    serving = make_serving(here, folder)
    is_chosen = config.rollout.agent.profile is not None
    # Stored in resolved form, so that defaults of unset settings cannot change when it is resumed.
    config = config.model_copy(update={"rollout": resolved(config.rollout, serving.policy, tell)})
    # Errors in settings, tasks and models are found before browsers start.
    learner = Learner(config.learn, objective)
    training = Training(
        config,
        folder,
        tasks,
        serving=serving,
        learner=learner,
        replay=Replay(config.learn.replay, objective, seed=config.seed),
        where=config.rollout.server,
        secrets=secrets or Secrets(),
        show=show,
        tell=tell,
        stop=stop,
    )
    if config.learn.update.lora is not None:
        await asyncio.to_thread(check_targets, config.learn.update.lora, config.learn.model)
    failed = warn_by(tell)
    if (gpus := present_gpus()) is not None:
        with suppress(ConfigError, AttributeError):  # of a model whose memory cannot be estimated
            expected = await asyncio.to_thread(estimate, config.learn, gpus, local=here.local)
            if waits := waiting(config, expected, gpus.count):
                failed(waits)
            if not expected.fits:
                failed(f"an update may run out of GPU memory: {' '.join(expected.lines()[1].split())}")
    refuse_unjudgeable(config.rollout.judge, tasks)
    with ExitStack() as lock:
        if resume:  # before a server is touched that another process may be training with
            lock.enter_context(folder.locked())
        async with AsyncExitStack() as services_and_model:
            judge = serving_model(judging, gpus_of_judge, folder.path / JUDGE_LOG)
            await services_and_model.enter_async_context(judge)
            if config.rollout.policy.check or always_check:
                await check_judge(config.rollout.judge)  # once: later, one that is away is waited for
            await services_and_model.enter_async_context(serving)
            if (config.rollout.policy.check and not resume) or always_check:
                await _check_replies(config.rollout, serving, failed if is_chosen else None)
            where, tokens = await services_and_model.enter_async_context(
                services(_with_sessions_of_evaluations(config), secrets or Secrets())
            )
            yield Loaded(training, tasks, serving, learner, where, tokens, lock)


def _with_sessions_of_evaluations(config: TrainConfig) -> RunConfig:
    """The runs' settings, with as many sessions as collection and an evaluation take together."""
    collector, own = config.rollout.collector, config.evaluation.sessions if config.loop.staleness else None
    more = collector.model_copy(update={"sessions": collector.sessions + (own or 0)})
    return config.rollout.model_copy(update={"collector": more})


def is_complete(config: TrainConfig, out: Path, tell: Tell) -> bool:
    """Whether a training has no iteration left; if so, what is derived from them is written again.

    Args:
        config: the result of :func:`read_config`.
        out: the training's folder.
        tell: called with the failure of a tracker.

    Raises:
        StoreLocked: another process trains in the folder.
    """
    folder = TrainingFolder(out)
    if folder.stage(config.loop.iterations) is not None:
        return False
    with folder.locked(), tracking(config.trackers, out, config.project, folder.write_metrics(), tell):
        return True


def warm_start(
    config: TrainConfig, runs: Sequence[Path], tasks: Sequence[Task], folder: Path, tell: Tell
) -> TrainConfig:
    """Clone the successes of stored runs before the first iteration: every step that changed something, with
    ``learn.update`` and ``learn.replay.passes``. In a launch of several processes all of them call this.

    The runs may be of another policy, also of other people's. Replies are learned as texts, tokenized anew,
    from the requests stored with them; so those should be like the requests that the training will make.

    Args:
        config: of the training.
        runs: run folders.
        tasks: of the training; its test tasks may not be given away.
        folder: of the new weights. If it exists, it is what an earlier start made.
        tell: called with a line about it.

    Returns:
        The settings of a training from those weights.

    Raises:
        ConfigError: a run has test tasks, or tasks that leak them.
        TrainingError: there is nothing to train on, or the loss is not finite.
    """
    learn = config.learn
    if not folder.exists():
        updater, objective = Updater(learn.update, FilteredBC(), learn.model), FilteredBC()
        maker = SampleMaker(updater.renderer, cutoff_tokens=learn.update.cutoff_tokens)
        selection = ReplayConfig(steps=None, repetition_penalty=learn.replay.repetition_penalty)
        samples: list[Sample] = []
        for path in runs:
            run, replay = RunReader(path), Replay(selection, objective)
            refuse_leaks(list(run.tasks.values()), [task for task in tasks if task.split == "test"])
            replay.add(0, run)
            for ref in replay.draw().steps:
                step = run.trajectory(ref.attempt_id).episode.steps[ref.index]
                as_text = msgspec.structs.replace(
                    step, reply=msgspec.structs.replace(step.reply, tokens=None)
                )
                samples += maker.make([(as_text, 1.0)], run.image)
        if not samples:
            raise TrainingError(
                f"there is nothing to start from in {', '.join(map(str, runs))}",
                hint=f"no successful step could be used: {dict(maker.dropped) or 'none succeeded'}",
            )
        report = updater.update(samples, passes=learn.replay.passes)
        updater.save(folder)
        tell(f"warm start: {report.samples} steps x {learn.replay.passes}, loss {report.loss:.3g}; {folder}")
    local = config.local or LocalConfig(path=learn.model)
    if local.path == learn.model:
        local = local.model_copy(update={"path": str(folder)})
    started: dict[str, Any] = {"learn": learn.model_copy(update={"model": str(folder)})}
    return config.model_copy(update=started if config.vllm else started | {"local": local})


async def _check_replies(config: RunConfig, serving: Serving, warn: Tell | None) -> None:
    """Request a test reply of the model.

    Args:
        config: of the collection, in resolved form.
        serving: entered.
        warn: called if no reply holds an action, in place of raising: for settings that were chosen for the
            model, which may be untrained on purpose.

    Raises:
        PolicyError: there was no reply.
        ConfigError: no reply holds an action.
    """
    hint = (
        "do rollout.agent.profile and rollout.agent.prompt_format fit the model? configs/train/tiny.yaml has "
        "the tiny policy's (profile: tiny, prompt_format: compact, rounds: 0)"
    )
    try:
        await check_policy(Agent(serving.policy, config.agent), config.attempt.viewport)
    except ConfigError as error:
        if warn is None:
            skip = "; rollout.policy.check: false skips this"
            raise ConfigError(error.message, hint=hint + skip) from error
        warn(f"{error.message}; {hint}")


def _refuse_unusable_replies(config: TrainConfig, objective: Objective) -> None:
    """Refuse settings with which every step would be collected, and then left out.

    Raises:
        ConfigError: replies do not come from the full distribution, or are too old.
    """
    sampling = config.sampling.body()
    altered = altering(sampling) or ["temperature"] * (sampling.get("temperature") == 0)
    if objective.off_policy and altered:
        raise ConfigError(
            f"{config.learn.objective.name} needs replies of the full distribution, and the sampling sets "
            f"{', '.join(altered)}",
            hint="set top_p to 1 and extra_body.top_k to -1, as configs/train/group-is.yaml does",
        )
    if objective.max_age is not None and config.loop.staleness > objective.max_age:
        raise ConfigError(
            f"loop.staleness is {config.loop.staleness}, and {config.learn.objective.name} leaves out steps "
            f"that are more than {objective.max_age} updates old",
            hint="lower loop.staleness, or raise staleness in learn.objective.options",
        )


def make_serving(config: TrainConfig, folder: TrainingFolder) -> Serving:
    """The configured serving of the policy, not started yet.

    Raises:
        ConfigError: the settings contradict each other.
    """
    model = config.learn.model
    if config.vllm is None:
        local = config.local or LocalConfig(path=model)
        return LocalServing(local, choose_profile(config.rollout.agent.profile, Path(local.path).name))
    latest = folder.latest_weights()
    servers = config.vllm.each()
    servings = [
        EngineServing(
            server,
            model,
            folder.path,
            log=LOG if len(servers) == 1 else f"vllm-{number}.log",
            lora=config.learn.update.lora,
            profile=choose_profile(config.rollout.agent.profile, Path(model).name),
            newest=(latest[1], str(latest[0])) if latest else None,
        )
        for number, server in enumerate(servers, 1)
    ]
    return servings[0] if len(servings) == 1 else EngineFleet(servings)


def load_train_config(files: Sequence[Path], overrides: Mapping[str, Any] | None = None) -> TrainConfig:
    """Settings from YAML files, each overriding those before it, and from options, which override the files.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing, unknown or out of range.
    """
    return load_settings(TrainConfig, files, "see configs/train/ for examples", overrides)


def read_config(out: Path, overrides: Mapping[str, Any] | None = None) -> TrainConfig:
    """The config that a training was started with.

    Args:
        out: the training's folder.
        overrides: settings that are others from now on, which are not stored.

    Raises:
        RunFolderError: the folder is not a training folder of this version.
    """
    if (out / TASKS).is_file():
        raise RunFolderError(
            f"{out} is a run, not a training", hint=f"resume it with webgym rollout --resume {out}"
        )
    refuse_special_files(out)
    try:
        data = yaml.safe_load((out / CONFIG).read_text())
    except OSError as error:
        raise RunFolderError(
            f"{out} is not a training: it has no {CONFIG}", hint="give the folder that webgym train wrote"
        ) from error
    confirm(data or {}, out / CONFIG)
    data = merged(data, overrides) if overrides else data
    return validated(TrainConfig, data, f"{out}/{CONFIG}", failure=RunFolderError)


_POLL_SECONDS: Final = 0.5


def is_follower() -> bool:
    """Whether this is not the first process of the launch, which runs the training."""
    return int(os.environ.get("RANK") or 0) > 0


def follow(config: TrainConfig, out: Path) -> None:
    """Run the updates together with the first process, until all are done or it stops for lack of time. If it
    fails, the launcher ends this process.

    Args:
        config: of the training.
        out: the training's folder, on a disk common to all processes.

    Raises:
        TrainingError: as in the first process.
    """
    folder, objective = TrainingFolder(out), make_objective(config.learn.objective)
    learner, earlier = Learner(config.learn, objective), folder.stopped
    for number in range(1, config.loop.iterations + 1):
        while not folder.is_past(number, Stage.REPLAY):
            if folder.stopped not in ("", earlier):
                return
            time.sleep(_POLL_SECONDS)
        draw = folder.draw(number)
        if draw.steps and not folder.is_past(number, Stage.UPDATE):
            learner.learn(number, draw, folder)
