"""The model against what queueing theory says in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import simpy

from webgym.simulate.config import Costs, Queues, System, Workload, demand, draw_steps
from webgym.simulate.model import Inference, Process, Processors, simulate
from webgym.simulate.sizing import Prices, scaled, size

# Nothing takes time but what a test sets.
NOTHING = Costs(
    open_cpu=0,
    act_cpu=1e-9,
    look_cpu=1e-9,
    cpu_sigma=0,
    page_seconds=0,
    prompt_tokens=1,
    reply_tokens=1e-9,
    judge_seconds=0,
)


def costs(**changes: object) -> Costs:
    return NOTHING.model_copy(update=changes)


def short(trajectories: int) -> Workload:
    return Workload(trajectories=trajectories, mean_steps=3.0, budgets=(3, 3, 3), mix=(1, 1, 1))


# --- the workload -----------------------------------------------------------------------------------------


def test_lengths_have_the_asked_for_mean_and_keep_their_budgets() -> None:
    workload = Workload()
    steps = draw_steps(workload, 20_000)
    assert steps.mean() == pytest.approx(13.2, rel=0.02)
    assert steps.max() == 45
    assert steps.min() >= 1


def test_a_trajectory_asks_for_the_same_whatever_else_is_drawn() -> None:
    assert demand(Workload(), Costs(), 7, 12) == demand(Workload(), Costs(), 7, 12)
    assert demand(Workload(), Costs(), 7, 12) != demand(Workload(), Costs(), 8, 12)


# --- processors -------------------------------------------------------------------------------------------


def test_one_processor_with_random_arrivals_waits_as_long_as_theory_says() -> None:
    """M/M/1 at a load of 0.7: the time in the system is service / (1 - load)."""
    env = simpy.Environment()
    processors = Processors(env, 1, "global")
    generator = np.random.default_rng(0)
    count = 40_000
    gaps = generator.exponential(1.0, count).tolist()
    services = generator.exponential(0.7, count).tolist()
    times: list[float] = []

    def visit(service: float) -> Process:
        came = env.now
        yield from processors.use("any", service)
        times.append(env.now - came)

    def arrivals() -> Process:
        for gap, service in zip(gaps, services, strict=True):
            yield env.timeout(gap)
            env.process(visit(service))

    env.process(arrivals())
    env.run()
    assert np.mean(times) == pytest.approx(0.7 / (1 - 0.7), rel=0.1)
    assert processors.busy == 0


@pytest.mark.parametrize(("queues", "navigated", "seen"), [("global", 120, 0), ("per_operation", 60, 15)])
def test_screenshots_behind_a_burst_of_navigations(queues: Queues, navigated: int, seen: int) -> None:
    """After the paper's toy: 180 navigations at once, 60 a second, with a screenshot behind each."""
    env = simpy.Environment()
    processors = Processors(env, 1, queues)
    done = {"navigate": 0, "screenshot": 0}

    def visit() -> Process:
        for operation, seconds in (("navigate", 1 / 60), ("screenshot", 1 / 15)):
            yield from processors.use(operation, seconds)
            done[operation] += 1

    for _ in range(180):
        env.process(visit())
    env.run(2.0)
    assert done["navigate"] == pytest.approx(navigated, abs=2)
    assert done["screenshot"] == pytest.approx(seen, abs=1)


# --- GPUs -------------------------------------------------------------------------------------------------


def replies(gpus: float, count: int, settings: Costs, tokens: float = 100) -> float:
    """Seconds until so many requests at once have been answered."""
    env = simpy.Environment()
    inference = Inference(env, gpus, settings)
    env.run(env.all_of([env.process(inference.reply(tokens)) for _ in range(count)]))
    assert inference.requests == 0
    return float(env.now)


def test_a_batch_is_as_slow_as_its_iterations() -> None:
    settings = costs(decode_seconds=0.01, decode_seconds_per_reply=0.001, batch=10)
    assert replies(1, 1, settings) == pytest.approx(100 * 0.011, rel=0.01)
    assert replies(1, 10, settings) == pytest.approx(100 * 0.020, rel=0.01)
    assert replies(1, 20, settings) == pytest.approx(200 * 0.020, rel=0.01), (
        "two batches, one after the other"
    )
    assert replies(2, 20, settings) == pytest.approx(100 * 0.020, rel=0.01), "a batch on each"
    assert replies(0.5, 10, settings) == pytest.approx(2 * 100 * 0.020, rel=0.01), "half as fast"


def test_requests_are_read_at_the_prefill_rate() -> None:
    settings = costs(prompt_tokens=10_000, prefill_tokens_per_second=1000.0, prefill_chunk=1000)
    settings = settings.model_copy(update={"decode_seconds": 1e-6})
    assert replies(1, 4, settings, tokens=1) == pytest.approx(40, rel=0.01)
    assert replies(4, 4, settings, tokens=1) == pytest.approx(4 * 10 / 4 + 10 * 3 / 4, rel=0.01)


# --- the whole --------------------------------------------------------------------------------------------


def test_saturated_processors_do_their_work_and_no_more() -> None:
    found = simulate(System(cpus=4, environments=64), costs(act_cpu=1.0), short(400))
    assert found.cpu == pytest.approx(1.0, abs=0.03)
    assert found.rate == pytest.approx(4.0, rel=0.03)
    assert found.steps == draw_steps(short(400), 400).sum()


def test_environments_that_only_wait_are_independent() -> None:
    """Each step takes a constant time and nothing is shared: rate = environments / time."""
    page = costs(page_seconds=2.0, page_sigma=0.0)
    found = simulate(System(cpus=64, environments=10), page, short(2000))
    assert found.rate == pytest.approx(10 / 2.0, rel=0.02)


def test_measured_waits_are_drawn_as_they_are() -> None:
    """A barrier of many meets the longest of them in every round, one environment their mean."""
    page = costs(page_waits=(0.0, 0.0, 0.0, 8.0))
    assert simulate(System(cpus=64, environments=1), page, short(2000)).rate == pytest.approx(0.5, rel=0.1)
    workload = Workload(trajectories=640, mean_steps=2.9, budgets=(2, 2, 2), mix=(1, 1, 1))
    barrier = System(cpus=256, environments=64, schedule="step_barrier")
    assert simulate(barrier, page, workload).seconds == pytest.approx(10 * 2 * 8.0, rel=0.01)


def test_a_step_barrier_waits_for_the_slowest_of_all() -> None:
    """In lock step a round is as long as the longest of n draws; without a barrier, as their mean."""
    sigma, group = 1.0, 32
    page = costs(page_seconds=1.0, page_sigma=sigma, page_longest=1e9)
    workload = Workload(trajectories=20 * group, mean_steps=2.9, budgets=(2, 2, 2), mix=(1, 1, 1))
    system = System(cpus=256, environments=group)
    draws = np.exp(sigma * np.random.default_rng(0).normal(size=(20_000, group)))
    barrier = simulate(system.model_copy(update={"schedule": "step_barrier"}), page, workload)
    free = simulate(system, page, workload)
    # Nearly all trajectories have two steps, so a group has two rounds.
    assert barrier.seconds == pytest.approx(40 * draws.max(axis=1).mean(), rel=0.1)
    assert free.rate == pytest.approx(group / draws.mean(), rel=0.1)


def test_an_episode_barrier_lies_between() -> None:
    settings, workload = Costs(), Workload(trajectories=256)
    seconds = {
        schedule: simulate(System(cpus=16, environments=64, schedule=schedule), settings, workload).seconds
        for schedule in ("async", "episode_barrier", "step_barrier")
    }
    assert seconds["async"] < seconds["episode_barrier"] < seconds["step_barrier"]


def test_a_lock_step_that_refills_is_faster() -> None:
    workload = Workload(trajectories=256)
    system = System(cpus=16, environments=64, schedule="step_barrier")
    group, refilled = (
        simulate(system.model_copy(update={"refills": refills}), Costs(), workload)
        for refills in (False, True)
    )
    assert refilled.seconds < group.seconds
    assert refilled.steps == group.steps


def test_judges_that_are_too_few_hold_browsers_up() -> None:
    found = simulate(System(cpus=64, environments=16, judges=2), costs(judge_seconds=10.0), short(200))
    assert found.seconds == pytest.approx(200 * 10 / 2, rel=0.05)


def test_stragglers_are_cut_after_the_grace_period() -> None:
    page = costs(page_seconds=10.0, page_sigma=0.0)
    workload = Workload(trajectories=100)
    whole = simulate(System(environments=100), page, workload)
    system = System(environments=100, straggler_share=0.5, straggler_seconds=5.0)
    cut = simulate(system, page, workload)
    assert whole.cut == 0
    assert 0 < cut.cut <= 50
    assert cut.seconds < whole.seconds


@pytest.mark.parametrize(("staleness", "seconds"), [(0, 4 * (100 + 80)), (1, 4 * 100 + 80)])
def test_training_overlaps_with_collection_as_far_as_staleness_allows(staleness: int, seconds: float) -> None:
    """Four iterations of 100 s of collection and 80 s of training."""
    settings = costs(page_seconds=10.0, page_sigma=0.0, train_seconds=80.0)
    workload = Workload(trajectories=20, mean_steps=1.5, budgets=(1, 1, 1), mix=(1, 1, 1))
    system = System(environments=2, iterations=4, staleness=staleness)
    assert simulate(system, settings, workload).seconds == pytest.approx(seconds, rel=0.01)


# --- sizing -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "bottleneck"),
    [
        ({"cpus": 4, "gpus": 100.0, "environments": 32}, "cpus"),
        ({"cpus": 512, "gpus": 0.2, "environments": 64}, "gpus"),
        ({"cpus": 512, "gpus": 100.0, "environments": 16}, "environments"),
        ({"cpus": 512, "gpus": 100.0, "environments": 64, "judges": 1}, "judges"),
    ],
)
def test_the_bottleneck_is_what_there_is_too_little_of(changes: dict[str, float], bottleneck: str) -> None:
    workload = Workload(mean_steps=4.0, budgets=(5, 10, 15))
    found = size(System.model_validate(changes), Costs(), workload, Prices(cpu=1, gpu=10))
    assert found.bottleneck == bottleneck
    assert found.limits[found.bottleneck] > 0.5
    assert found.per_hour == changes["cpus"] + 10 * changes["gpus"]
    assert found.per_thousand == pytest.approx(1000 * found.per_hour / found.rates["async"])


def test_a_large_system_is_simulated_as_a_small_one_of_the_same_proportions() -> None:
    system = System(cpus=10_000, gpus=1000, environments=40_000)
    small, factor = scaled(system)
    assert small.environments <= 260
    assert small.cpus / small.gpus == pytest.approx(10)
    assert small.environments / small.cpus == pytest.approx(4, rel=0.02)
    assert factor == small.cpus / 10_000
    assert scaled(System(cpus=10_000, gpus=8, environments=40_000))[0].gpus == pytest.approx(1)
    assert scaled(System(cpus=4, gpus=0.5, environments=16)) == (
        System(cpus=4, gpus=0.5, environments=16, judges=16),
        1.0,
    )


def test_a_small_system_stands_for_a_larger_one() -> None:
    """Twice as much of everything does twice as much, to a few percent."""
    rates = [
        simulate(
            System(cpus=16 * by, gpus=2 * by, environments=64 * by), Costs(), Workload(trajectories=256 * by)
        )
        for by in (1, 2)
    ]
    one, two = (found.steady.rate for found in rates if found.steady is not None)
    assert two == pytest.approx(2 * one, rel=0.06)
