"""The loop's stages: each is done once, in order, and a training that stopped anywhere goes on there."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.train.forking import process
from tests.train.making import PICTURES, task, trajectory
from tests.train.worlds import Copy, MadeUp, training_of

from webgym.agent.config import AgentConfig
from webgym.agent.profiles import choose_profile
from webgym.browser.config import BrowserConfig
from webgym.core.errors import ConfigError, PublishError, TrainingError, WebGymError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Reply, Trajectory
from webgym.core.verdict import Judgement, Verdict
from webgym.inference.local import LocalConfig
from webgym.judge.config import JudgeChoice, JudgeConfig
from webgym.judge.offline import OfflineJudge
from webgym.llm.config import ChatConfig, Sampling
from webgym.offline.config import SitesConfig
from webgym.results.summary import Summary
from webgym.rollout.config import AttemptConfig
from webgym.rollout.sessions import Places
from webgym.run.config import RunConfig, read_config
from webgym.store.runs import RunReader
from webgym.train.config import FrontierConfig, LearnConfig, ReplayConfig
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.loop import EvaluationConfig, LoopConfig, TrainConfig
from webgym.train.replay import ReplaySample

TASKS = [task(f"a{number}") for number in range(12)] + [task(f"b{number}", "test") for number in range(3)]

SAMPLING = choose_profile(None, "m").sampling.body()


class Killed(BaseException):
    """The process ends here."""


def end() -> None:
    raise Killed


class World(MadeUp):
    """What a training talks to, with a log of what was done; may be made to end before any of it."""

    def __init__(
        self,
        *,
        kill_before: int | None = None,
        outcome: Outcome | None = None,
        refuses: str = "",
        sampling: dict[str, Any] = SAMPLING,
        judge: str = "",
    ) -> None:
        super().__init__()
        self._verdict = Verdict(judge, 1, (), Judgement(False, "no")) if judge else None
        self._sampling = sampling
        self.pictures = PICTURES
        self._refuses = refuses
        self.failed = asyncio.Event()
        self.log: list[str] = []
        self.served = "0"
        self._kill_before = kill_before
        self._outcome = outcome
        self.kill: Callable[[], object] = end

    def do(self, what: str) -> None:
        if self._kill_before == 0:
            self.kill()
        if self._kill_before is not None:
            self._kill_before -= 1
        self.log.append(what)

    def attempt(self, run: Path, task: Task, number: int, seed: int) -> Trajectory:
        name = f"{run.parent.name}/{run.name}" if run.name == "run" else run.name
        self.do(f"attempt {name} {task.id} by {self.served}")
        outcome = self._outcome or (Outcome.SUCCESS, Outcome.FAILURE, Outcome.BLOCKED)[number % 3]
        reply = Reply("click", "p", sampling=self._sampling)
        found = trajectory(0, of=task.id.removeprefix("t/"), outcome=outcome, reply=reply)
        return msgspec.structs.replace(found, verdict=self._verdict)

    def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        self.do(f"learn {number} from {len(draw.steps)}")
        weights = folder.weights(number)
        weights.mkdir(parents=True, exist_ok=True)
        (weights / "state.json").write_text("{}")
        return {"samples": len(draw.steps), "loss": 1.0}

    async def publish(self, weights: Path, version: str) -> None:
        if version == self._refuses:
            raise PublishError("the served model does not pass its self-test")
        self.do(f"publish {version}")
        self.served = version

    async def watch(self) -> None:
        await self.failed.wait()
        raise TrainingError("the policy's model was changed by others")


def judge(model: str, url: str = "http://127.0.0.1:1/v1") -> JudgeChoice:
    return JudgeChoice(name="rubric", rubric=JudgeConfig(chat=ChatConfig(base_url=url, model=model)))


def on_pages(**settings: Any) -> RunConfig:
    return RunConfig(judge=judge("m"), **settings)


def config(**loop: Any) -> TrainConfig:
    return TrainConfig(
        learn=LearnConfig(model="m", replay=ReplayConfig(steps=6), frontier=FrontierConfig()),
        loop=LoopConfig(**({"iterations": 3, "tasks": 4, "evaluate_every": 2} | loop)),
        evaluation=EvaluationConfig(count=2),
    )


def run(path: Path, world: World, settings: TrainConfig, tasks: Sequence[Task] = TASKS) -> list[Any]:
    return asyncio.run(training_of(path, world, settings, tasks).run())


def done(world: World) -> list[str]:
    return [line for line in world.log if not line.startswith("attempt")]


def made(path: Path) -> dict[str, Any]:
    """What a training left, but for the time that it took."""
    found: dict[str, Any] = {}
    for each in sorted(path.rglob("*.jsonl")):
        name = str(each.relative_to(path))
        if "trajectories" in name:
            found[name] = len(each.read_bytes().splitlines())
        elif each.name in ("tasks.jsonl", "batch.jsonl"):
            found[name] = each.read_bytes()
    return found


class FileLog(list[str]):
    """Is in a file, too, which stays whatever happens to the process."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def append(self, line: str) -> None:
        with self._file.open("a") as file:
            file.write(f"{line}\n")


def live(path: Path, make: type[World], settings: TrainConfig, steps: int) -> None:
    """In a process of its own: ends by SIGKILL before so much was done."""
    world = make(kill_before=steps)
    world.log = FileLog(path.with_suffix(".log"))
    world.kill = lambda: os.kill(os.getpid(), signal.SIGKILL)
    run(path, world, settings)


def life(path: Path, make: type[World], settings: TrainConfig, steps: int) -> list[str]:
    """What was done in a life that was killed."""
    path.with_suffix(".log").touch()
    killed = process(live, path, make, settings, steps)
    killed.start()
    killed.join()
    assert killed.exitcode in (0, -signal.SIGKILL)
    return path.with_suffix(".log").read_text().splitlines()


def made_again(killed: list[str], again: World, planned: int) -> int:
    """How many of so many attempts were made twice."""
    attempts = [line.split(" by ")[0] for line in (*killed, *again.log) if line.startswith("attempt")]
    assert len(set(attempts)) == planned
    return len(attempts) - planned


def test_iterations_follow_each_other_and_each_is_collected_by_the_weights_before_it(tmp_path: Path) -> None:
    world = World()
    rows = run(tmp_path, world, config())
    assert done(world) == [
        "learn 1 from 6",
        "publish 1",
        "learn 2 from 6",
        "publish 2",
        "learn 3 from 6",
        "publish 3",
    ]
    for number in (1, 2, 3):
        own = [line for line in world.log if line.startswith(f"attempt {number:04d}/run")]
        assert len(own) == 4
        assert all(line.endswith(f"by {number - 1}") for line in own)
    assert [row["trajectories"] for row in rows] == [4, 8, 12]
    folder = TrainingFolder(tmp_path)
    assert sorted(folder.evaluations()) == [0, 2, 3]
    assert rows[1]["evaluation"]["attempts"] == 2
    assert all(each.id.startswith("t/a") for number in (1, 2, 3) for each in folder.tasks(number))


def test_samples_of_one_test_task_are_one_piece_of_evidence(tmp_path: Path) -> None:
    settings = config(iterations=1, evaluate_every=1)
    settings = settings.model_copy(update={"evaluation": EvaluationConfig(count=2, samples=4)})
    run(tmp_path, World(), settings)
    for found in TrainingFolder(tmp_path).evaluations().values():
        assert (found["attempts"], found["success_rate"]["overall"]) == (8, 0.5)
        for name in ("success_interval", "success_interval_of_planned"):
            assert found[name]["overall"] == [0.0, 1.0], "one of two tasks is always solved, one never"
            assert found[name]["hard"] is None


def test_evaluations_have_their_own_sampling_and_collection_does_not(tmp_path: Path) -> None:
    chosen = Sampling(top_p=0.99, extra_body={"top_k": 2})
    settings = config(iterations=1, evaluate_every=1)
    run(
        tmp_path,
        World(),
        settings.model_copy(update={"evaluation": EvaluationConfig(count=2, sampling=chosen)}),
    )
    folder = TrainingFolder(tmp_path)
    made = {
        path: read_config(RunReader(path))[0].agent.sampling for path in (folder.run(1), folder.evaluation(1))
    }
    assert list(made.values()) == [None, chosen]


@pytest.mark.parametrize(
    ("changed", "differs"),
    [
        ({"evaluation": EvaluationConfig(count=3)}, "test tasks"),
        ({"evaluation": EvaluationConfig(count=2, seed=1)}, "evaluation.seed"),
        ({"evaluation": EvaluationConfig(count=2, samples=2)}, "evaluation.samples"),
        ({"evaluation": EvaluationConfig(count=2, budget=(3, 5, 7))}, "evaluation.budget"),
        ({"rollout": RunConfig(judge=judge("another"))}, "rollout.judge"),
        ({"rollout": RunConfig(judge=judge("m"), agent=AgentConfig(rounds=1))}, "rollout.agent"),
        ({"local": LocalConfig(path="m", sampling=Sampling(temperature=0.5))}, "sampling"),
        ({"evaluation": EvaluationConfig(count=2, sampling=Sampling(top_p=0.5))}, "sampling"),
        ({"local": LocalConfig(path="m", threads=1)}, ""),
        ({"local": LocalConfig.model_validate(LocalConfig(path="m").model_dump(mode="json"))}, ""),
        ({"rollout": on_pages(browser=BrowserConfig(settle_seconds=1))}, "rollout.browser"),
        ({"rollout": on_pages(browser=BrowserConfig(launch_seconds=9))}, ""),
        ({"rollout": on_pages(sites=SitesConfig(latency=0))}, "rollout.sites"),
        ({"rollout": on_pages(attempt=AttemptConfig(viewport=(640, 384)))}, "rollout.attempt.viewport"),
        ({"rollout": RunConfig(judge=judge("m", "http://127.0.0.1:2/v1"), retries=5)}, ""),
    ],
)
def test_evaluations_that_cannot_be_compared_are_not_points_of_one_curve(
    tmp_path: Path, changed: dict[str, Any], differs: str
) -> None:
    settings = config(iterations=1).model_copy(update={"rollout": RunConfig(judge=judge("m"))})
    run(tmp_path, World(), settings)
    more = settings.model_copy(update={"loop": config(iterations=2).loop, **changed})
    if not differs:
        run(tmp_path, World(), more)
        return
    with pytest.raises(ConfigError, match=f"evaluations/0001 had other values: {differs} "):
        run(tmp_path, World(), more)
    (tmp_path / "evaluations").rename(tmp_path / "earlier")  # as the hint says
    run(tmp_path, World(), more)
    assert sorted(TrainingFolder(tmp_path).evaluations()) == [2]


def test_test_tasks_that_were_rewritten_are_others(tmp_path: Path) -> None:
    run(tmp_path, World(), config(iterations=1))
    rewritten = [msgspec.structs.replace(each, instruction="find it!") for each in TASKS]
    with pytest.raises(ConfigError, match="evaluations/0001 had other values: test tasks "):
        run(tmp_path, World(), config(iterations=2), rewritten)


def test_another_version_of_a_judge_is_another_judge(tmp_path: Path) -> None:
    run(tmp_path / "same", World(judge=OfflineJudge.name), config(iterations=1))
    run(tmp_path / "same", World(), config(iterations=2))
    run(tmp_path / "other", World(judge="offline/1"), config(iterations=1))
    with pytest.raises(ConfigError, match=r"rollout\.judge \(offline/1, now offline/\d+\) "):
        run(tmp_path / "other", World(), config(iterations=2))


@pytest.fixture(scope="module")
def whole_trainings(tmp_path_factory: pytest.TempPathFactory) -> dict[int, dict[str, Any]]:
    """What trainings leave that nothing happened to, by their staleness."""
    found = {}
    for staleness in (0, 2):
        path = tmp_path_factory.mktemp("whole")
        run(path, World(), config(staleness=staleness))
        found[staleness] = made(path)
    return found


@pytest.mark.parametrize(
    ("steps", "staleness"),
    [(steps, 0) for steps in (0, 1, 3, 6, 7, 8, 11, 13, 15, 18, 24, 25)]
    + [(steps, 2) for steps in (0, 2, 5, 9, 14, 17, 20, 24)],
)
def test_a_training_that_is_killed_anywhere_ends_as_if_it_had_not_been(
    tmp_path: Path, whole_trainings: dict[int, dict[str, Any]], steps: int, staleness: int
) -> None:
    killed = life(tmp_path / "killed", World, config(staleness=staleness), steps)
    again = World()
    rows = run(tmp_path / "killed", again, config(staleness=staleness))
    assert made(tmp_path / "killed") == whole_trainings[staleness]
    assert [row["trajectories"] for row in rows] == [4, 8, 12]
    assert made_again(killed, again, 12 + 6) <= (1 if staleness else 0), "but in other runs"


class Late(World):
    """The last attempt of an iteration, a success, ends only once the next iteration goes on, or was done."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.begun = [asyncio.Event() for _ in range(7)]

    async def before(self, run: Path, number: int, tasks: int, places: Places | None) -> None:
        if run.name != "run":
            return
        iteration = int(run.parent.name)
        self.begun[iteration - 1].set()
        if number == tasks - 1 and places is not None and iteration < 6:
            places.spare.set()
            places.enough.set()
            await self.begun[iteration].wait()

    def attempt(self, run: Path, task: Task, number: int, seed: int) -> Trajectory:
        found = super().attempt(run, task, number, seed)
        return msgspec.structs.replace(found, outcome=Outcome.SUCCESS) if number == 3 else found


def used_once(path: Path) -> dict[tuple[int, str], int]:
    """The update that each attempt was used in, of a training that used every step at most once."""
    folder, drawn = TrainingFolder(path), list[tuple[int, str, int]]()
    used_in: dict[tuple[int, str], int] = {}
    for number in range(1, 7):
        drawn += [(ref.iteration, ref.attempt_id, ref.index) for ref in folder.batch(number)]
        used_in |= {(ref.iteration, ref.attempt_id): number for ref in folder.batch(number)}
    assert len(drawn) == len(set(drawn)), "no step twice"
    won = {
        (number, each.episode.attempt_id, index)
        for number in range(1, 7)
        for each in RunReader(folder.run(number)).trajectories()
        if each.outcome is Outcome.SUCCESS
        for index in range(len(each.episode.steps))
    }
    assert set(drawn) <= won
    missing = {each[0] for each in won - set(drawn)}
    assert missing <= {5, 6}, "what ended after the last draw is all that was never used"
    return used_in


def once() -> TrainConfig:
    """Every step is trained on once, as soon as it is there."""
    given = config(iterations=6, staleness=2, evaluate_every=0)
    replay = ReplayConfig(steps=1000, passes=1, max_uses=1, recency=0)
    return given.model_copy(update={"learn": LearnConfig(model="m", replay=replay)})


def test_an_update_does_not_wait_for_stragglers_which_are_learned_from_once_with_a_later_one(
    tmp_path: Path,
) -> None:
    world = Late()
    rows = run(tmp_path, world, once())
    used_in = used_once(tmp_path)
    folder = TrainingFolder(tmp_path)
    for number in range(1, 5):
        first, *_, last = (f"{each.id}#0.0" for each in folder.tasks(number))
        assert used_in[number, first] == number
        assert used_in[number, last] > number
    assert [row["collect"]["outcomes"]["success"] for row in rows] == [2] * 6, "figures are of all attempts"
    assert [row["trajectories"] for row in rows] == [4, 8, 12, 16, 20, 24]


@pytest.mark.parametrize("steps", [1, 6, 9, 12, 16, 23, 30])
def test_late_attempts_are_used_once_wherever_the_training_was_killed(tmp_path: Path, steps: int) -> None:
    out, again = tmp_path / "out", Late()
    killed = life(out, Late, once(), steps)
    rows = run(out, again, once())
    used_once(out)
    assert [row["trajectories"] for row in rows] == [4, 8, 12, 16, 20, 24]
    assert made_again(killed, again, 24) <= 2, "what was in flight in other runs"


class Evaluates(World):
    """The evaluation after the second iteration ends only after the given was done, if that can be."""

    def __init__(self, until: str, copies: bool) -> None:
        super().__init__()
        self._until, self._copies = until, copies
        self.evaluated: list[tuple[str, str]] = []

    def copy(self) -> Copy | None:
        return Copy() if self._copies else None

    async def attempts(self, out: Path, *given: Any) -> Summary:
        if out.name != "run":
            self.evaluated.append((out.name, given[2].name if self._copies else self.served))
            if out.name == "0002":
                async with asyncio.timeout(5):
                    while self._until not in done(self):
                        await asyncio.sleep(0.01)
        return await super().attempts(out, *given)


def test_an_evaluation_goes_on_beside_the_training_with_the_weights_that_it_began_with(
    tmp_path: Path,
) -> None:
    world = Evaluates("publish 4", copies=True)
    rows = run(tmp_path, world, config(iterations=6, staleness=1, keep_weights=1))
    assert world.evaluated == [(f"{number:04d}", str(number)) for number in (0, 2, 4, 6)]
    assert [row["evaluation"] is not None for row in rows] == [False, True] * 3


def test_where_weights_cannot_be_copied_new_ones_wait_for_the_end_of_an_evaluation(tmp_path: Path) -> None:
    world = Evaluates("learn 3 from 6", copies=False)
    run(tmp_path, world, config(iterations=4, staleness=1))
    assert world.evaluated == [(f"{number:04d}", str(number)) for number in (0, 2, 4)]
    log = [line.split(" from ")[0] for line in world.log]
    assert log.index("learn 3") < log.index(next(x for x in log if x.startswith("attempt 0002 ")))


@pytest.mark.parametrize("copies", [True, False])
def test_an_evaluation_that_was_killed_goes_on_with_the_weights_that_it_began_with(
    tmp_path: Path, copies: bool
) -> None:
    class Killing(Evaluates):
        def do(self, what: str) -> None:
            if what.startswith("attempt 0002 "):
                raise Killed
            super().do(what)

    settings = config(iterations=4, staleness=1, keep_weights=1)
    first = Killing("publish 4" if copies else "learn 3 from 6", copies)
    with suppress(Killed, BaseExceptionGroup):
        run(tmp_path, first, settings)
    assert TrainingFolder(tmp_path).is_past(3, Stage.UPDATE)
    again = Evaluates("publish 2" if not copies else "publish 4", copies)
    run(tmp_path, again, settings)
    assert again.evaluated == [("0002", "2"), ("0004", "4")]


def test_an_update_waits_until_enough_trajectories_are_gathered(tmp_path: Path) -> None:
    """Two of four attempts succeed in each iteration, so that one is left after the second."""
    told: list[str] = []
    replay = ReplayConfig(steps=1000, trajectories=3, passes=1, max_uses=1)
    settings = config(iterations=6, evaluate_every=0)
    settings = settings.model_copy(update={"learn": LearnConfig(model="m", replay=replay)})
    world = World()
    training = training_of(tmp_path, world, settings, TASKS)
    training._tell = told.append
    asyncio.run(training.run())
    folder = TrainingFolder(tmp_path)
    assert [bool(folder.batch(number)) for number in range(1, 7)] == [False, True, True] * 2
    assert "iteration 1: 2 of 3 trajectories for an update; collecting goes on" in told
    assert done(world)[:2] == ["learn 2 from 9", "publish 2"]


def test_an_update_takes_what_there_is_once_the_replay_would_forget_the_first(tmp_path: Path) -> None:
    replay = ReplayConfig(iterations=2, steps=1000, trajectories=99, passes=1, max_uses=1)
    settings = config(iterations=4, evaluate_every=0)
    run(tmp_path, World(), settings.model_copy(update={"learn": LearnConfig(model="m", replay=replay)}))
    folder = TrainingFolder(tmp_path)
    assert [bool(folder.batch(number)) for number in range(1, 5)] == [False, True] * 2


def test_collection_may_run_ahead_as_far_as_staleness_says(tmp_path: Path) -> None:
    world = World()
    run(tmp_path, world, config(staleness=1, iterations=4, evaluate_every=0))
    for number in range(1, 5):
        own = [line for line in world.log if line.startswith(f"attempt {number:04d}/run")]
        versions = {int(line.rpartition(" ")[2]) for line in own}
        assert min(versions) >= number - 2


def test_nothing_to_learn_from_leaves_the_weights_and_ends_with_a_line_in_the_end(tmp_path: Path) -> None:
    world = World(outcome=Outcome.FAILURE)
    with pytest.raises(BaseExceptionGroup) as caught:
        run(tmp_path, world, config(iterations=9, give_up_after=2))
    (error,) = caught.value.exceptions
    assert isinstance(error, TrainingError)
    assert "2 iterations in a row had nothing to train on: no step had an advantage" in str(error)
    assert done(world) == []
    assert TrainingFolder(tmp_path).is_past(2, Stage.COLLECT)
    with pytest.raises(BaseExceptionGroup) as caught:  # a resume has not learned from anything either
        run(tmp_path, World(outcome=Outcome.FAILURE), config(iterations=9, give_up_after=2))
    assert "3 iterations in a row" in str(caught.value.exceptions[0])


@pytest.mark.parametrize(("most_lost", "evaluated"), [(0.5, []), (1.0, [0])])
def test_an_evaluation_whose_samples_were_lost_to_errors_does_not_count(
    tmp_path: Path, most_lost: float, evaluated: list[int]
) -> None:
    with pytest.raises(BaseExceptionGroup) as caught:
        run(tmp_path, World(outcome=Outcome.JUDGE_ERROR), config(most_lost=most_lost, give_up_after=1))
    (error,) = caught.value.exceptions
    assert isinstance(error, TrainingError)
    assert evaluated or "2 of 2 samples of evaluations/0000 were lost to errors" in str(error)
    assert sorted(TrainingFolder(tmp_path).evaluations()) == evaluated


async def test_an_update_is_carried_through_when_the_training_is_stopped(tmp_path: Path) -> None:
    """Its thread goes on anyway, and would save weights while the next process trains in the folder."""
    begun, may_end = threading.Event(), threading.Event()

    class Slow(World):
        def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
            begun.set()
            assert may_end.wait(100)
            return super().learn(number, draw, folder)

    work = asyncio.create_task(training_of(tmp_path, Slow(), config(evaluate_every=0), TASKS).run())
    await asyncio.to_thread(begun.wait, 100)
    work.cancel()
    await asyncio.wait({work}, timeout=0.1)
    was_done = work.done()
    may_end.set()
    await asyncio.wait({work})
    assert work.cancelled()
    assert not was_done
    assert TrainingFolder(tmp_path).stage(1) is Stage.FINISH, "what was learned is not learned again"


def test_what_has_learned_is_not_evaluated_as_if_it_had_not(tmp_path: Path) -> None:
    with suppress(Killed, BaseExceptionGroup):
        run(tmp_path, World(kill_before=5), config(evaluate_every=0))
    again = World()
    run(tmp_path, again, config())
    assert done(again)[0] == "publish 1"
    assert sorted(TrainingFolder(tmp_path).evaluations()) == [2, 3]


@pytest.mark.parametrize("keep", [1, 2])
def test_weights_that_are_not_taken_end_the_training_and_are_published_when_it_goes_on(
    tmp_path: Path, keep: int
) -> None:
    world = World(refuses="2")
    with pytest.raises(BaseExceptionGroup) as caught:
        run(tmp_path, world, config(keep_weights=keep))
    (error,) = caught.value.exceptions
    assert isinstance(error, PublishError)
    assert world.served == "1"
    assert TrainingFolder(tmp_path).weights(1).exists(), "they are served, and may be needed again"
    again = World()
    rows = run(tmp_path, again, config(keep_weights=keep))
    assert done(again)[0] == "publish 2"
    assert [row["trajectories"] for row in rows] == [4, 8, 12]


def test_a_server_that_fails_ends_the_training(tmp_path: Path) -> None:
    class Failing(World):
        async def attempts(self, *given: Any) -> Summary:
            self.failed.set()
            await asyncio.sleep(60)
            raise AssertionError

    with pytest.raises(BaseExceptionGroup) as caught:
        run(tmp_path, Failing(), config())
    (error,) = caught.value.exceptions
    assert "was changed by others" in str(error)


@pytest.mark.parametrize(
    ("tasks", "told"),
    [
        ([task("a", None)], "split 'unsplit'"),
        ([task("b", "test")], "no task to draw"),
    ],
)
def test_without_training_tasks_nothing_starts(tmp_path: Path, tasks: list[Task], told: str) -> None:
    with pytest.raises(WebGymError, match=told):
        training_of(tmp_path, World(), config(), tasks)


def test_the_newest_weights_stay_and_the_best_of_those_that_were_evaluated(tmp_path: Path) -> None:
    run(tmp_path, World(), config(keep_weights=1, iterations=6))
    folder = TrainingFolder(tmp_path)
    kept = [path.parent.name for path in sorted(tmp_path.glob("iterations/*/weights"))]
    assert kept == ["0006"], "all evaluations are equal: the newest is the best"
    for number in (1, 2, 3, 4, 5):
        folder.weights(number).mkdir()
    for number, rate in ((2, 0.5), (4, None), (6, 0.25)):
        folder.write_evaluation(number, {"success_rate": {"overall": rate}})
    assert folder.best_weights() == folder.weights(2)
    folder.finish(2, Stage.UPDATE, {})  # as if there had been nothing to train on
    assert folder.best_weights() == folder.weights(1)
    (folder.weights(5) / "training").mkdir()
    (folder.weights(6) / "training").mkdir()
    folder.prune_weights(2, 6)
    assert [path.parent.name for path in sorted(tmp_path.glob("iterations/*/weights"))] == [
        "0001",
        "0005",
        "0006",
    ]
    assert not (folder.weights(5) / "training").exists()
    assert (folder.weights(6) / "training").exists()
