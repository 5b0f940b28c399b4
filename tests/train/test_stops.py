"""What a training stops at: a line, an exit code, nothing lost, and a way to go on."""

from __future__ import annotations

import asyncio
import errno
import json
import re
import resource
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import huggingface_hub.constants
import msgspec
import pytest
import torch
import yaml
from safetensors.torch import load_file
from tests.conftest import Calls
from tests.inference.tiny import write_tiny_model
from tests.train import test_loop
from tests.train.making import task
from tests.train.test_loop import World

from webgym.agent.scripted import RandomPolicy
from webgym.core.errors import ConfigError, StoreError, StoreFull, StoreLocked, TrainingError, WebGymError
from webgym.core.task import Task
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Reply, Trajectory
from webgym.run.config import Secrets, ServerChoice, resolved
from webgym.store import files
from webgym.tasks.formats import write_tasks
from webgym.train.estimate import Gpus
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay
from webgym.train.serving import LocalServing
from webgym.train.start import load_train_config, open_training, read_config
from webgym.train.update import Learner
from webgym.train.weights import read_state


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_model(tmp_path_factory.mktemp("model") / "tiny")


def config(model: Path, **update: Any) -> TrainConfig:
    given = {"precision": "fp32", "learning_rate": 1e-3, "warmup_steps": 0, "batch": 3, "micro_batch": 3}
    return TrainConfig.model_validate(
        {
            "learn": {"model": str(model), "replay": {"steps": 6, "passes": 1}, "update": given | update},
            "loop": {"iterations": 2, "tasks": 4, "evaluate_every": 0},
        }
    )


def run(path: Path, settings: TrainConfig, world: World | None = None) -> list[dict[str, Any]]:
    """A training whose learner is real, and whose attempts are made up."""
    world, objective = world or World(), make_objective(settings.learn.objective)
    training = Training(
        settings,
        TrainingFolder(path),
        test_loop.TASKS,
        serving=world,
        learner=Learner(settings.learn, objective),
        replay=Replay(settings.learn.replay, objective),
        where=ServerChoice(),
        secrets=Secrets(),
        attempts=world.attempts,
    )
    return asyncio.run(training.run())


def only(error: BaseExceptionGroup[Any]) -> BaseException:
    (cause,) = error.exceptions
    return only(cause) if isinstance(cause, BaseExceptionGroup) else cause


def weights(folder: TrainingFolder, number: int) -> dict[str, torch.Tensor]:
    return load_file(folder.weights(number) / "model.safetensors")


# --- a loss that is not a number ----------------------------------------------------------------------------


@pytest.mark.parametrize("poison", [float("nan"), float("inf")])
def test_a_loss_that_is_no_number_stops_before_its_weights_are_saved(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch, poison: float
) -> None:
    from webgym.train.update import Updater

    honest, calls = Updater._loss, []

    def loss(self: Updater, *given: Any) -> Any:
        calls.append(given)
        return honest(self, *given) * (poison if self.step >= 3 else 1.0)

    with monkeypatch.context() as patch:
        patch.setattr(Updater, "_loss", loss)
        with pytest.raises(BaseExceptionGroup) as caught:
            run(tmp_path, config(model))
    error = only(caught.value)
    assert isinstance(error, TrainingError)
    assert re.fullmatch(r"the loss of optimizer step 3 is (nan|inf).*learning_rate.*--resume\)", str(error))
    folder = TrainingFolder(tmp_path)
    assert folder.latest_weights() == (1, folder.weights(1))
    assert not folder.weights(2).exists()
    assert folder.is_past(2, Stage.REPLAY)
    assert all(value.isfinite().all() for value in weights(folder, 1).values())

    rows = run(tmp_path, config(model, learning_rate=1e-4))

    assert rows[1]["update"]["learning_rate"] == 1e-4
    assert read_state(folder.weights(2)).step == 4


# --- a draw of which nothing can be learned -----------------------------------------------------------------


class Foreign(World):
    """Its replies are of another model's tokens."""

    def attempt(self, run: Path, task: Task, number: int, seed: int) -> Trajectory:
        made = super().attempt(run, task, number, seed)
        tokens = ReplyTokens.of(prompt_ids=[1], reply_ids=[2], logprobs=[-1.0])
        reply = Reply("click", "p", tokens=tokens)
        steps = tuple(msgspec.structs.replace(each, reply=reply) for each in made.episode.steps)
        return msgspec.structs.replace(made, episode=msgspec.structs.replace(made.episode, steps=steps))


def test_what_is_said_of_a_draw_of_which_nothing_can_be_learned_leads_on(tmp_path: Path, model: Path) -> None:
    settings = config(model)
    settings = settings.model_copy(update={"loop": settings.loop.model_copy(update={"iterations": 1})})

    def hint() -> str:
        with pytest.raises(BaseExceptionGroup) as caught:
            run(tmp_path, settings, Foreign())
        error = only(caught.value)
        assert isinstance(error, TrainingError)
        assert "all 6 steps were dropped" in str(error)
        return error.hint

    iteration = tmp_path / "iterations/0001"
    assert hint().endswith("; then move iterations/0001 elsewhere, and --resume collects it again")
    (iteration / "run/trajectories/00000.jsonl").write_bytes(b"")  # set aside, all of them
    assert hint().endswith(": delete iterations/0001/replay.json, and --resume draws others")
    (iteration / "replay.json").unlink()
    assert [row["update"] for row in run(tmp_path, settings)] == [{}]
    iteration.rename(tmp_path / "elsewhere")
    assert [row["update"]["samples"] for row in run(tmp_path, settings)] == [6]
    assert (iteration / "tasks.jsonl").read_bytes() == (tmp_path / "elsewhere/tasks.jsonl").read_bytes()


# --- a disk that is full -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole_training(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a training leaves that nothing happened to."""
    path = tmp_path_factory.mktemp("whole")
    test_loop.run(path, World(), test_loop.config())
    return test_loop.made(path)


@pytest.mark.parametrize(
    "name",
    "tasks.jsonl sampler.json collected.json batch.jsonl replay.json update.json metrics.json metrics.jsonl "
    "0002.json".split(),
)
def test_a_disk_that_is_full_in_any_stage_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole_training: dict[str, Any], name: str
) -> None:
    settings = test_loop.config()
    whole = files.write_whole
    refused: list[Path] = []

    def write(path: Path, data: bytes, **options: Any) -> None:
        if path.name == name and not refused:
            refused.append(path)
            raise OSError(errno.ENOSPC, "No space left on device")
        whole(path, data, **options)

    monkeypatch.setattr("webgym.train.folder.write_whole", write)
    first, second = World(), World()
    with pytest.raises((StoreFull, BaseExceptionGroup)) as caught:
        test_loop.run(tmp_path / "full", first, settings)
    error = only(caught.value) if isinstance(caught.value, BaseExceptionGroup) else caught.value
    assert isinstance(error, StoreFull)
    assert "--resume" in str(error)
    rows = test_loop.run(tmp_path / "full", second, settings)
    assert test_loop.made(tmp_path / "full") == whole_training
    assert [row["trajectories"] for row in rows] == [4, 8, 12]
    attempts = [line.split(" by ")[0] for line in (*first.log, *second.log) if line.startswith("attempt")]
    assert len(attempts) == len(set(attempts))


@contextmanager
def files_no_larger_than(limit: int) -> Iterator[None]:
    """What the system says then is told like a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("share", [0.5, 1.5])
def test_weights_for_which_there_is_no_space_leave_the_last_ones(
    tmp_path: Path, model: Path, share: float
) -> None:
    """Half the weights, then all of them and half an optimizer: safetensors and torch tell it their ways."""
    size = (model / "model.safetensors").stat().st_size
    with files_no_larger_than(int(size * share)), pytest.raises(BaseExceptionGroup) as caught:
        run(tmp_path, config(model))
    error = only(caught.value)
    assert isinstance(error, StoreFull)
    assert "saving weights" in str(error)
    folder = TrainingFolder(tmp_path)
    assert folder.latest_weights() is None
    assert [path.name for path in folder.iteration(1).iterdir() if "weights" in path.name] == []
    rows = run(tmp_path, config(model))
    assert [row["iteration"] for row in rows] == [1, 2]


# --- before anything starts --------------------------------------------------------------------------------


def one_line(said: str) -> str:
    (line,) = [each for each in said.splitlines() if each.startswith("webgym:")]
    assert "Traceback" not in said
    return line


@pytest.fixture
def no_browsers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that is refused here may cost a browser."""

    def never(*_: object, **__: object) -> None:
        raise AssertionError("browsers were started")

    monkeypatch.setattr("webgym.train.start.services", never)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)


def settings_file(path: Path, model: object, **others: Any) -> Path:
    write_tasks(path / "tasks.jsonl", [task("a"), task("b", "test")])
    held = {
        "learn": {"model": str(model)},
        "rollout": {"tasks": {"file": str(path / "tasks.jsonl")}},
    } | others
    (path / "train.yaml").write_text(yaml.safe_dump(held))
    return path / "train.yaml"


@pytest.mark.usefixtures("no_browsers")
def test_what_cannot_be_trained_is_refused_before_browsers_start(
    tmp_path: Path, model: Path, calls: Calls
) -> None:
    def refused(**others: Any) -> str:
        given = settings_file(tmp_path, **({"model": model} | others))
        code, said = calls.run("train", given, "--out", tmp_path / "out")
        assert code == 2
        assert not (tmp_path / "out").exists()
        return one_line(said)

    assert "cannot load the model no-such/model" in refused(model="no-such/model")
    assert "there is no such folder (check its path)" in refused(model=tmp_path / "nowhere")
    # The one that collects is there; the one that would learn, after an iteration, is not.
    assert "cannot load the model" in refused(model=tmp_path / "nowhere", local={"path": str(model)})
    assert "did you mean learn.update.learning_rate?" in refused(
        learn={"model": str(model), "update": {"learning_rat": 1}}
    )
    of_section = refused(learn={"model": str(model)}, evaluation={"tasks": 4})
    assert (
        "evaluation has budget, count, samples, sampling, seed, sessions; did you mean loop.tasks?"
        in of_section
    )
    assert "unknown objective 'ppo'" in refused(learn={"model": str(model), "objective": {"name": "ppo"}})
    alone = refused(learn={"model": str(model), "objective": {"name": "group_is"}})
    assert "rollout.samples is 1" in alone
    assert "shares no tasks" in refused(rollout={"collector": {"sharing": {"folder": str(tmp_path)}}})
    groups = {"model": str(model), "objective": {"name": "group_is"}}
    held = yaml.safe_load(settings_file(tmp_path, model).read_text())["rollout"] | {"samples": 2}
    local = {"path": str(model), "sampling": {"top_p": 0.99, "extra_body": {"top_k": 2}}}
    assert "the sampling sets top_p, top_k" in refused(learn=groups, rollout=held, local=local)
    local["sampling"] = {"top_p": 1.0, "temperature": 0.0}
    assert "the sampling sets temperature" in refused(learn=groups, rollout=held, local=local)
    local["sampling"] = {"top_p": 1.0}
    late = refused(learn=groups, rollout=held, local=local, loop={"staleness": 3})
    assert "loop.staleness is 3, and group_is leaves out steps that are more than 2 updates old" in late
    for targets in ("nothing", ""):
        adapters = {"model": str(model), "update": {"lora": {"targets": targets}}}
        assert "lora.targets matches no module" in refused(learn=adapters)
    (tmp_path / "none").mkdir()
    assert "tasks.jsonl" in refused(rollout={"tasks": {"file": str(tmp_path / "none" / "tasks.jsonl")}})

    write_tasks(tmp_path / "unsplit.jsonl", [task("a", None)])
    only_test = [task("a", "test"), task("b", "test")]
    write_tasks(tmp_path / "test.jsonl", only_test)
    for name, told in (("unsplit", "webgym tasks split makes one"), ("test", "no task to draw")):
        assert told in refused(rollout={"tasks": {"file": str(tmp_path / f"{name}.jsonl")}})

    # A rubric's facts cannot be judged by the offline judge: found before anything is attempted.
    assert "offline" in refused()


@pytest.mark.usefixtures("no_browsers")
def test_an_update_that_does_not_fit_the_gpus_is_told_at_the_start(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.train.start.present_gpus", lambda: Gpus(memory_gib=0.01))
    told: list[str] = []

    async def start() -> None:
        given = load_train_config([settings_file(tmp_path, model)])
        async with open_training(given, tmp_path / "out", tell=told.append):
            pass

    with pytest.raises(ConfigError, match="offline"):
        asyncio.run(start())
    (line,) = told
    assert re.match(r"an update may run out of GPU memory: memory [\d.]+ GiB per GPU, DOES NOT FIT", line)


AGENT = {"profile": "tiny", "prompt_format": "compact", "rounds": 0}


@pytest.fixture
def no_services(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """No browsers and websites; notes that they were to be started."""
    started: list[str] = []

    @asynccontextmanager
    async def services(*_: object) -> AsyncIterator[Any]:
        started.append("services")
        yield ServerChoice(), Secrets()

    monkeypatch.setattr("webgym.train.start.services", services)
    return started


@pytest.mark.parametrize("agent", [{}, AGENT])
def test_a_model_without_a_valid_reply_is_refused_unless_its_settings_were_chosen(
    tmp_path: Path, model: Path, no_services: list[str], agent: dict[str, Any]
) -> None:
    settings = TrainConfig.model_validate(
        {
            "learn": {"model": str(model)},
            "rollout": {"sites": {"collection": "small", "per_family": 5}, "agent": agent},
            "local": {"path": str(model), "sampling": {"max_tokens": 4}},
        }
    )
    told: list[str] = []

    async def start(settings: TrainConfig) -> None:
        async with open_training(settings, tmp_path / "out", tell=told.append):
            pass

    names = re.escape("configs/train/tiny.yaml has the tiny policy's (profile: tiny, prompt_format: compact")
    if agent:
        asyncio.run(start(settings))
        (line,) = [line for line in told if "replied" in line]
        assert re.search(f"never with a valid action; .*{names}", line)
        return
    with pytest.raises(ConfigError, match=f"never with a valid action.*{names}.*check: false skips"):
        asyncio.run(start(settings))
    assert not no_services
    assert not (tmp_path / "out").exists()
    policy = settings.rollout.policy.model_copy(update={"check": False})
    unchecked = settings.rollout.model_copy(update={"policy": policy})
    asyncio.run(start(settings.model_copy(update={"rollout": unchecked})))
    assert not any("replied" in line for line in told)


@pytest.mark.usefixtures("no_services")
def test_a_training_goes_on_with_what_it_was_started_with(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Small websites have a small viewport unless it is set; config.yaml sets everything."""
    sites = {"collection": "small", "per_family": 5}
    rollout = {"sites": sites, "agent": {"profile": "tiny"}, "policy": {"check": False}}  # random weights
    settings = TrainConfig.model_validate({"learn": {"model": str(model)}, "rollout": rollout})

    async def start(given: TrainConfig, *, resume: bool) -> TrainConfig:
        async with open_training(given, tmp_path / "out", resume=resume) as training:
            assert len(servings) == 1 + resume
            with pytest.raises(StoreLocked):
                async with open_training(training.config, tmp_path / "out", resume=True):
                    raise AssertionError("it trains a second time")
            assert len(servings) == 1 + resume, "a server that trains already is not touched"
            return training.config

    servings = []

    class CountedServing(LocalServing):
        async def __aenter__(self) -> CountedServing:
            servings.append(self)
            return await super().__aenter__()

    monkeypatch.setattr("webgym.train.start.LocalServing", CountedServing)
    begun = asyncio.run(start(settings, resume=False))
    again = asyncio.run(start(read_config(tmp_path / "out"), resume=True))
    assert again == begun
    assert resolved(again.rollout, RandomPolicy(), None).attempt.viewport == (192, 128)
    assert (tmp_path / "out/tensorboard").is_dir()


@pytest.mark.usefixtures("no_browsers")
def test_a_folder_that_is_taken_is_refused_at_once(tmp_path: Path, model: Path, calls: Calls) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("keep me")
    code, said = calls.run("train", settings_file(tmp_path, model), "--out", tmp_path / "out")
    assert code == 2
    assert one_line(said).endswith("is not empty (choose another folder)")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["thesis.txt"]
    (tmp_path / "out" / "config.yaml").touch()
    _, said = calls.run("train", settings_file(tmp_path, model), "--out", tmp_path / "out")
    assert f"(webgym train --resume {tmp_path}/out continues what it holds; or" in one_line(said)


def test_two_processes_do_not_train_in_one_folder(tmp_path: Path) -> None:
    folder = TrainingFolder(tmp_path)
    with folder.locked(), pytest.raises(WebGymError, match="is writing to"), folder.locked():
        pass
    with folder.locked():
        pass


def test_what_a_dead_training_was_writing_is_deleted_by_the_next(tmp_path: Path) -> None:
    folder = TrainingFolder(tmp_path)
    folder.write(1, "sampler.json", {})
    folder.evaluation(0).mkdir(parents=True)
    folder.write_evaluation(0, {})
    kept = set(tmp_path.rglob("*"))
    for name in (
        ".metrics.jsonl.ab.tmp",
        "iterations/0001/.sampler.json.ab.tmp",
        "evaluations/.0000.json.ab.tmp",
    ):
        (tmp_path / name).write_bytes(b"{")
    (tmp_path / "iterations/0001/.weights.new.tmp").mkdir()
    (tmp_path / "iterations/0001/.weights.new.tmp/state.json").write_bytes(b"{}")
    with folder.locked():
        assert set(tmp_path.rglob("*")) - {tmp_path / ".lock"} == kept


def test_an_error_of_the_disk_that_is_not_about_space_is_told_too(tmp_path: Path) -> None:
    (tmp_path / "iterations").write_text("in the way")
    with pytest.raises(StoreError, match="making"):
        TrainingFolder(tmp_path).write(1, "x.json", json.loads("{}"))
