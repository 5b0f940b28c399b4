"""The policy endpoint of ``webgym bench rollout``, its plan, and what is made of its figures."""

from __future__ import annotations

import os
from argparse import Namespace
from collections import Counter
from pathlib import Path

import httpx
import msgspec
import pytest
import simpy
from benchmarks import collector
from tests.conftest import Calls
from tests.documented import documented

from webgym.agent.formats import parse_reply
from webgym.agent.parser import ParsedReply
from webgym.bench.rollout.endpoint import Engine, PrefixCache, Script, serving_endpoint
from webgym.bench.rollout.measure import measure_into
from webgym.bench.rollout.plan import MODES, PAGE_LATENCIES, PARTS, Cell, PageLatency, RolloutPlan, scripts_of
from webgym.bench.rollout.results import (
    Load,
    Measured,
    begin,
    beside_simulation,
    comparison_table,
    draw_rollout,
    file_of,
    loaded_service_times,
    read_bench,
    rollout_tables,
    service_times,
)
from webgym.cli import main
from webgym.core.errors import ConfigError, RunFolderError
from webgym.offline import latency
from webgym.offline.web import OfflineWeb
from webgym.simulate.config import Costs
from webgym.simulate.model import Inference, Process

COSTS = Costs(
    prefill_tokens_per_second=1000.0,
    prefill_chunk=100,
    decode_seconds=0.01,
    decode_seconds_per_reply=0.001,
    batch=4,
)
PLAN = RolloutPlan(trajectories=8, sessions=4, cpus=(1, 2), mean_steps=5.0, rounds=2)


# --- the engine -------------------------------------------------------------------------------------------


def finish(engine: Engine[int]) -> dict[int, float]:
    """When each reply is complete, in seconds from now."""
    now = 0.0
    ended: dict[int, float] = {}
    while engine.requests:
        seconds, done = engine.iterate()
        now += seconds
        ended |= dict.fromkeys(done, now)
    return ended


def test_a_request_is_read_in_chunks_and_then_written_a_token_per_iteration() -> None:
    engine = Engine[int](COSTS)
    engine.submit(250, 10, 1)
    # Three iterations read 100, 100 and 50 tokens; ten write one token each.
    assert finish(engine) == {1: pytest.approx(3 * 0.01 + 0.25 + 10 * 0.011)}
    assert (engine.read_tokens, engine.written_tokens) == (250, 10)


def test_the_simulation_takes_the_engine_for_a_fluid() -> None:
    """Both give the same throughput under a closed load, to a few percent."""
    costs, clients, count = COSTS.model_copy(update={"batch": 16}), 24, 300
    engine, now, ended, submitted = Engine[int](costs), 0.0, 0, clients
    for ticket in range(clients):
        engine.submit(50, 40, ticket)
    while ended < count:
        seconds, done = engine.iterate()
        now, ended = now + seconds, ended + len(done)
        for _ in done:
            submitted += 1
            engine.submit(50, 40, submitted)
    env = simpy.Environment()
    fluid, replies = Inference(env, 1, costs.model_copy(update={"prompt_tokens": 50})), Counter[str]()

    def client() -> Process:
        while True:
            yield from fluid.reply(40)
            replies["done"] += 1

    for _ in range(clients):
        env.process(client())
    env.run(now)
    assert replies["done"] == pytest.approx(ended, rel=0.15)


def test_what_begins_alike_is_read_once() -> None:
    cache = PrefixCache(1000)
    assert cache.unread([("system", 100), ("task", 10)]) == 110
    assert cache.unread([("system", 100), ("task", 10), ("picture", 50)]) == 50
    assert cache.unread([("system", 100), ("other", 10), ("picture", 50)]) == 60, "behind another message"
    assert cache.unread([("long", 2000)]) == 2000
    assert cache.unread([("system", 100)]) == 100, "forgotten"


# --- the endpoint -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scripts() -> list[Script]:
    return scripts_of(PLAN, OfflineWeb(per_family=4), 8)


def test_a_script_browses_and_answers_at_its_last_step(scripts: list[Script]) -> None:
    script = msgspec.structs.replace(scripts[0], steps=40)
    read = [parse_reply(script.reply(step), "marks", "memory") for step in range(40)]
    actions = [one.action for one in read if isinstance(one, ParsedReply)]
    assert len(actions) == 40
    kinds = Counter(type(action).__name__ for action in actions)
    assert set(kinds) == {"LeftClick", "Scroll", "Navigate", "Answer"}
    assert kinds["Answer"] == 1
    assert type(actions[-1]).__name__ == "Answer"


async def test_replies_follow_the_script_and_a_new_attempt_begins_it_anew(scripts: list[Script]) -> None:
    script = msgspec.structs.replace(scripts[0], steps=3, tokens=[1.0, 1.0, 1.0])
    user = {"role": "user", "content": f"The task: {script.task.instruction}"}
    async with (
        serving_endpoint([script], Costs(), 2) as endpoint,
        httpx.AsyncClient(base_url=endpoint.url, trust_env=False, timeout=60) as client,
    ):

        async def ask(*messages: dict[str, str]) -> str:
            answer = await client.post("/chat/completions", json={"model": "bench", "messages": messages})
            assert answer.status_code == 200
            text: str = answer.json()["choices"][0]["message"]["content"]
            return text

        replies = [await ask(user)]
        for _ in range(2):
            replies.append(await ask(user, {"role": "assistant", "content": replies[-1]}, user))
        assert replies == [script.reply(step) for step in range(3)]
        assert await ask(user) == replies[0]
        unknown = {"model": "bench", "messages": [{"role": "user", "content": "?"}]}
        assert (await client.post("/chat/completions", json=unknown)).status_code == 400
        assert endpoint.requests == 0
        assert 0 < endpoint.read_tokens < endpoint.prompt_tokens


# --- the plan and its figures -----------------------------------------------------------------------------


def measured(cell: Cell, seconds: float) -> Measured:
    return Measured(
        cell=cell,
        seconds=seconds,
        outcomes={"failure": 6, "environment_error": 2},
        steps=40,
        cpu_seconds=20.0,
        policy_seconds=10.0,
        prompt_tokens=4000,
        read_tokens=2000,
        between=[0.6, 0.7, 1.5],
        loads=[Load(1.0, 0.5, 0.5, 2), Load(2.0, 0.9, 0.1, 1)],
        machine_load=0.5,
    )


@pytest.mark.parametrize(("name", "longest", "median"), [("paper", 60.0, 1.0), ("paper_cut", 10.0, 1.0)])
def test_pages_are_as_late_as_the_simulation_says_and_browsers_wait_for_them(
    name: PageLatency, longest: float, median: float
) -> None:
    network = PAGE_LATENCIES[name]
    sites = network.sites
    drawn = [
        latency.seconds(
            0, "a.test", "/", nth, sites.latency, sigma=sites.latency_sigma, longest=sites.latency_longest
        )
        for nth in range(4000)
    ]
    assert max(drawn) == pytest.approx(longest)
    assert sorted(drawn)[2000] == pytest.approx(median, rel=0.1)
    assert network.browser.navigate_seconds > longest
    assert network.browser.settle_seconds >= longest


def test_every_mode_is_measured_at_every_number_of_processors() -> None:
    cells = list(PLAN.cells(PARTS))
    assert len({cell.name for cell in cells}) == len(cells)
    schedules = [(cell.cpus, cell.mode) for cell in cells if cell.part == "schedules"]
    forwards = [(cpus, mode.name) for cpus in (1, 2) for mode in MODES]
    assert schedules == [*forwards, *reversed(forwards)]
    chosen = PLAN.cells(["schedules"], ["async", "step barrier, fixed group"])
    assert [(cell.schedule, cell.refills) for cell in chosen][:2] == [
        ("async", True),
        ("step_barrier", False),
    ]
    assert [cell.part for cell in cells].count("calibration") == 1


def test_what_was_measured_is_kept_and_belongs_to_its_plan(tmp_path: Path) -> None:
    assert begin(PLAN, tmp_path) == []
    cell = next(PLAN.cells(["calibration"]))
    file_of(tmp_path, cell).write_bytes(msgspec.json.encode(measured(cell, 30.0)))
    assert begin(PLAN, tmp_path) == [measured(cell, 30.0)]
    assert read_bench(tmp_path) == (PLAN, [measured(cell, 30.0)])
    with pytest.raises(RunFolderError, match="another plan"):
        begin(msgspec.structs.replace(PLAN, seed=1), tmp_path)
    with pytest.raises(RunFolderError, match="no results"):
        read_bench(tmp_path / "elsewhere")


def test_an_unfinished_one_prints_what_it_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begin(PLAN, tmp_path)
    cell = next(PLAN.cells(["schedules"]))
    file_of(tmp_path, cell).write_bytes(msgspec.json.encode(measured(cell, 30.0)))
    options = "--trajectories 8 --sessions 4 --cpus 1 --cpus 2 --mean-steps 5 --rounds 2 --markdown".split()
    for more in ([], ["--mode", "async"], ["--mode", "episode barrier"]):
        with pytest.raises(SystemExit) as ended:
            main(["bench", "rollout", "--no-measure", "--out", str(tmp_path), *options, *more])
        assert ended.value.code == 0
        assert ("1 CPUs, async" in capsys.readouterr().out) == (more != ["--mode", "episode barrier"])
    with pytest.raises(SystemExit) as ended:
        main(["bench", "rollout", "--out", str(tmp_path), "--mode", "async, two queues"])
    assert ended.value.code == 2
    assert (
        "unknown mode 'async, two queues' (choose one of async; async, one queue; step"
        in capsys.readouterr().err
    )
    assert not list(tmp_path.glob("*.run"))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--cpus", "100000"], "100000 processors are requested, but only"),
        (["--cpus", "1"], "there is no browser at"),
        (["--cpus", "1", "--no-measure"], "contains no results of webgym bench rollout"),
        (["--out", "file"], "file cannot be written: File exists"),
        (["--figure", "drawn.doc"], "drawn.doc has no suffix of a figure format"),
    ],
)
def test_what_cannot_be_measured_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: Calls, options: list[str], reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    if "--out" in options:
        monkeypatch.setattr("webgym.bench.rollout.measure.check_machine", lambda cells: None)
    code, said = calls.run("bench", "rollout", *options, WEBGYM_BROWSER="none")
    assert code > 0
    (line,) = said.splitlines()
    assert reason in line
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_the_collector_alone_takes_the_pages_numbers_of_sessions(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def measure(sessions: int, given: Namespace) -> str:
        return f"| {sessions} sessions of {given.steps} steps |"

    monkeypatch.setattr(collector, "measure", measure)
    words = documented("python benchmarks/collector.py --sessions 100 1000")
    monkeypatch.setattr("sys.argv", ["collector.py", *words])
    collector.main()
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "| 100 sessions of 13 steps |",
        "| 1000 sessions of 13 steps |",
    ]


@pytest.mark.parametrize(
    ("parts", "drawn"),
    [
        (["capacity"], {"Policy capacity"}),
        (["overload"], {"Overload"}),
        (["capacity", "overload"], {"Policy capacity", "Overload"}),
    ],
)
def test_a_drawing_has_the_panels_that_were_measured(
    tmp_path: Path, parts: list[str], drawn: set[str]
) -> None:
    draw_rollout([measured(cell, 30.0) for cell in PLAN.cells(parts)], tmp_path / "found.svg")
    shown = (tmp_path / "found.svg").read_text()
    titles = ("Policy capacity", "Overload", "Wall time", "CPU use")
    assert {title for title in titles if f"<!-- {title} -->" in shown or f">{title}<" in shown} == drawn


def test_rounds_become_a_median_and_a_range_of_ratios_within_a_round() -> None:
    plan = msgspec.structs.replace(PLAN, rounds=3, cpus=(1,))
    seconds = {"async": (10.0, 20.0, 10.0), "step barrier": (20.0, 30.0, 40.0)}
    found = [
        measured(cell, seconds.get(cell.mode, (10.0,) * 3)[cell.round]) for cell in plan.cells(["schedules"])
    ]
    (table,) = rollout_tables(found)
    (row,) = [row for row in table.rows if row[0] == "1 CPUs, step barrier"]
    assert row[1:3] == ("30 (20–40)", "2.00 (1.50–4.00)")
    assert len(table.rows) == len(MODES)


def test_attempts_whose_policy_failed_are_no_speed() -> None:
    plan = msgspec.structs.replace(PLAN, rounds=1, cpus=(1,))
    whole, short = [measured(cell, 30.0) for cell in plan.cells(["schedules"], ["async", "step barrier"])]
    short = msgspec.structs.replace(short, outcomes={"failure": 2, "policy_error": 6}, seconds=9.0, steps=12)
    (table,) = rollout_tables([whole, short])
    assert [(row[2], row[6]) for row in table.rows] == [("1.00", "25.0%"), ("–", "75.0%")]
    stopped = msgspec.structs.replace(whole, outcomes={"failure": 6, "cancelled": 2})
    assert stopped.lost == 0, "by the time limit"


def test_cells_in_which_no_attempt_made_a_step_are_told_and_measured_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = RolloutPlan(trajectories=12, sessions=6, cpus=(1,), mean_steps=5.0, rounds=1)
    cells = list(plan.cells(["calibration", "schedules"], ["async", "step barrier"]))
    whole = [measured(cell, 30.0) for cell in cells]
    empty = [
        msgspec.structs.replace(one, outcomes={"environment_error": 8}, steps=0, between=[]) for one in whole
    ]
    assert list(beside_simulation(plan, [whole[0], *empty[1:]])) == []
    assert loaded_service_times(plan, [whole[0], *empty[1:]]) == service_times(plan, whole[:1])
    begin(plan, tmp_path)
    file_of(tmp_path, cells[0]).write_bytes(msgspec.json.encode(empty[0]))
    again: list[Cell] = []

    def measure_again(folder: Path, plan: RolloutPlan, cell: Cell) -> Measured:
        again.append(cell)
        return empty[0]

    monkeypatch.setattr("webgym.bench.rollout.measure.measure_into", measure_again)
    monkeypatch.setattr("webgym.bench.rollout.measure.check_machine", lambda cells: None)
    options = ["--quick", "--only", "calibration", "--cpus", "1", "--markdown"]
    with pytest.raises(SystemExit) as ended:
        main(["bench", "rollout", *options, "--out", str(tmp_path)])
    assert ended.value.code == 0
    assert again == [cells[0]]
    said = capsys.readouterr().out
    assert "| CPU seconds of a step | – |" in said
    assert "| attempts without a reward | 100.0% |" in said


def test_the_simulation_is_held_against_the_measurement() -> None:
    found = [measured(cell, 30.0) for cell in PLAN.cells(["calibration", "schedules"])]
    costs = service_times(PLAN, found)
    assert costs.act_cpu + costs.look_cpu == pytest.approx(0.5)
    assert costs.prompt_tokens == 50
    compared = list(beside_simulation(PLAN, found))
    assert [one.error for one in compared if one.mode == "async"] == [0.0, 0.0]
    assert next(one for one in compared if one.mode == "step barrier").simulated_ratio > 1
    assert len(comparison_table(compared).rows) == 2 * len(MODES)
    with pytest.raises(ConfigError, match="calibration"):
        service_times(PLAN, found[1:])


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.timeout(300)
@pytest.mark.parametrize("schedule", ["async", "step_barrier"])
def test_a_cell_is_measured_with_everything_real(tmp_path: Path, schedule: str) -> None:
    plan = RolloutPlan(trajectories=3, sessions=2, cpus=(1,), mean_steps=3.0, reply_tokens=5.0)
    cell = next(cell for cell in plan.cells(["schedules"]) if cell.schedule == schedule)
    before = os.sched_getaffinity(0)
    begin(plan, tmp_path)
    found = measure_into(tmp_path, plan, cell)
    assert os.sched_getaffinity(0) == before
    assert found.ended == 3
    assert found.lost == 0
    watched = sum(load.cpu_seconds for load in found.loads)
    assert found.cpu_seconds >= watched > 0, "processes that are gone with their session included"
    assert found.policy_seconds > 0
    assert found.steps == sum(script.steps for script in scripts_of(plan, OfflineWeb(), 3))
    assert read_bench(tmp_path) == (plan, [found])
    assert not list(tmp_path.glob("*.run"))
