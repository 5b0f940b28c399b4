"""The plan: every sample once, errors again, nothing twice."""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from contextlib import suppress

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.outcome import Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.rollout.plan import Plan, Planned
from webgym.store.records import Entry


def task(number: int) -> Task:
    rubric = Rubric((FactGroup(1, "group", ("fact",)),))
    return Task(f"t{number}", "do it", "http://x.test/", "Misc.", "News", rubric, "offline")


TASKS = [task(number) for number in range(5)]


def entry(planned: Planned, outcome: Outcome) -> Entry:
    place = ("00000.jsonl", 0, 1)
    return Entry(planned.attempt_id, planned.task.id, planned.sample, planned.retry, outcome, *place)


class Killed(Exception):
    """The collector is gone."""


async def carry_out(plan: Plan, rng: random.Random, *, stop_after: int | None = None) -> list[Entry]:
    """Play the plan with three workers and random outcomes, perhaps dying on the way."""
    recorded: list[Entry] = []

    async def work() -> None:
        while (planned := await plan.take()) is not None:
            await asyncio.sleep(0)
            if stop_after is not None and len(recorded) >= stop_after:
                raise Killed
            outcome = rng.choice(list(Outcome))
            recorded.append(entry(planned, outcome))
            await plan.settle(planned, outcome)

    with suppress(ExceptionGroup):
        async with asyncio.TaskGroup() as group:
            for _ in range(3):
                group.create_task(work())
    return recorded


def test_a_plan_and_its_resumption_add_up() -> None:
    """Also if records are lost between them, as those that ``webgym verify --set-aside`` moves."""
    drawn = st.lists(st.sampled_from(TASKS), min_size=1, max_size=8)  # some twice, as a sampler may draw them
    numbers = (st.integers(0, 2**32), st.integers(1, 3), st.integers(0, 3), st.integers(0, 20))

    @given(drawn, *numbers, st.sampled_from([0.0, 0.4]))
    def check(
        tasks: list[Task], seed: int, samples: int, retries: int, stop_after: int, losses: float
    ) -> None:
        rng = random.Random(seed)

        async def both() -> list[Entry]:
            first = await carry_out(Plan(tasks, samples=samples, retries=retries), rng, stop_after=stop_after)
            lost = {each.attempt_id for each in first if rng.random() < losses}
            first[:] = [each for each in first if each.attempt_id not in lost]
            resumed = Plan(tasks, samples=samples, retries=retries, recorded=first, retired=lost)
            second = await carry_out(resumed, rng)
            assert not lost & {each.attempt_id for each in second}, "a name is given once"
            assert resumed.done == resumed.total == samples * len(tasks)
            return first + second

        entries = asyncio.run(both())
        assert len({each.attempt_id for each in entries}) == len(entries)
        by_sample: dict[tuple[str, int], list[Outcome]] = {}
        for each in sorted(entries, key=lambda each: each.retry):
            by_sample.setdefault((each.task_id, each.sample), []).append(each.outcome)
        wanted = Counter(each.id for each in tasks * samples)
        assert Counter(task_id for task_id, _ in by_sample) == wanted
        for outcomes in by_sample.values():
            *before, last = outcomes
            assert all(outcome.is_retried for outcome in before)
            failures = Counter(outcome is not Outcome.CANCELLED for outcome in outcomes if outcome.is_retried)
            assert failures[True] <= retries + 1
            assert not last.is_retried or failures[True] == retries + 1

    check()


async def test_a_task_drawn_twice_is_two_attempts_and_each_is_made_again_by_itself() -> None:
    drawn = [TASKS[0], TASKS[1], TASKS[0]]
    plan = Plan(drawn, samples=2, retries=1)
    taken = [await plan.take() for _ in range(6)]
    ids = [planned.attempt_id for planned in taken if planned]
    assert ids == ["t0#0.0", "t1#0.0", "t0#1.0", "t0#2.0", "t1#1.0", "t0#3.0"]
    ended = dict(
        zip(ids, [Outcome.SUCCESS, *[Outcome.POLICY_ERROR] * 2, *[Outcome.FAILURE] * 3], strict=True)
    )
    recorded = [entry(planned, ended[planned.attempt_id]) for planned in taken[:4] if planned]
    resumed = Plan(drawn, samples=2, retries=1, recorded=recorded)
    rest = [await resumed.take() for _ in range(resumed.waiting)]
    assert [planned.attempt_id for planned in rest if planned] == ["t1#0.1", "t0#1.1", "t1#1.0", "t0#3.0"]
    assert resumed.done == 2


async def test_what_exhausted_its_retries_is_attempted_again_if_asked_for() -> None:
    one, two = TASKS[:2]
    recorded = [
        entry(Planned(one, 0), Outcome.POLICY_ERROR),
        entry(Planned(one, 0, 1), Outcome.ENVIRONMENT_ERROR),
        entry(Planned(two, 0), Outcome.FAILURE),
    ]
    assert await Plan([one, two], samples=1, retries=1, recorded=recorded).take() is None
    plan = Plan([one, two], samples=1, retries=1, recorded=recorded, retry_errors=True)
    assert (plan.done, plan.total) == (1, 2)
    tried = []
    while (planned := await plan.take()) is not None:
        tried.append(planned.attempt_id)
        await plan.settle(planned, Outcome.ENVIRONMENT_ERROR)
    assert tried == ["t0#0.2", "t0#0.3"], "as often as the run allows, under names of their own"


@pytest.mark.parametrize("retry_errors", [False, True])
async def test_the_number_of_an_attempt_is_above_all_that_are_and_were_there(retry_errors: bool) -> None:
    """Counting what is left would give a name again that is taken, and the run could never end."""
    recorded = [entry(Planned(TASKS[0], 0, 1), Outcome.ENVIRONMENT_ERROR)]
    retired = ["t0#0.0", "t1#0.2", "t9#0.0", "a name of somebody else's"]
    plan = Plan(
        TASKS[:3],
        samples=1,
        retries=1,
        recorded=recorded,
        retired=retired,
        retry_errors=retry_errors,
    )
    taken = [await plan.take() for _ in range(3)]
    assert [each.attempt_id for each in taken if each] == ["t0#0.2", "t1#0.3", "t2#0.0"]
    assert taken[0] is not None
    assert taken[0].failures == (0 if retry_errors else 1)


async def test_a_worker_waits_while_another_may_have_to_repeat() -> None:
    plan = Plan(TASKS[:1], samples=1, retries=1)
    planned = await plan.take()
    assert planned is not None
    waiting = asyncio.create_task(plan.take())
    await asyncio.sleep(0)
    assert not waiting.done()
    await plan.settle(planned, Outcome.POLICY_ERROR)
    again = await waiting
    assert again is not None
    assert again.retry == 1
    await plan.settle(again, Outcome.SUCCESS)


async def test_a_run_is_ending_when_a_share_is_done_and_all_others_have_begun() -> None:
    plan = Plan(TASKS, samples=1, retries=0)
    taken = [await plan.take() for _ in range(4)]
    for planned in taken[:3]:
        assert planned is not None
        await plan.settle(planned, Outcome.FAILURE)
    assert not plan.is_ending(0.4)  # one has not begun
    await plan.take()
    assert plan.is_ending(0.4)
    assert not plan.is_ending(0.8)


async def test_hardest_first_and_each_tasks_samples_as_ever() -> None:
    facts = {task(1).id: 2, task(2).id: 7}
    tasks = [
        msgspec.structs.replace(
            task(number),
            rubric=Rubric((FactGroup(1, "group", ("fact",) * facts.get(f"t{number}", 4)),)),
        )
        for number in range(4)
    ]
    plan = Plan(tasks, samples=2, retries=0, hardest_first=True)
    ids = [planned.attempt_id for _ in range(8) if (planned := await plan.take())]
    assert ids == ["t2#0.0", "t2#1.0", "t0#0.0", "t3#0.0", "t0#1.0", "t3#1.0", "t1#0.0", "t1#1.0"]


async def test_a_closed_plan_hands_nothing_out_and_a_final_end_is_not_made_again() -> None:
    plan = Plan(TASKS, samples=1, retries=1)
    one, two = await plan.take(), await plan.take()
    assert one is not None
    assert two is not None
    await plan.settle(one, Outcome.CANCELLED, is_final=True)
    assert (plan.done, plan.waiting) == (1, 3)
    await plan.settle(two, Outcome.CANCELLED)
    assert (plan.done, plan.waiting) == (1, 4)
    await plan.close()
    assert await plan.take() is None


async def test_no_more_attempts_at_a_website_than_it_takes_and_others_go_first() -> None:
    def at(number: int, website: str) -> Task:
        return msgspec.structs.replace(task(number), website=website)

    tasks = [*(at(number, f"https://{number}.busy.test") for number in range(3)), at(3, "https://calm.test")]
    plan = Plan(tasks, samples=1, retries=0, per_website=2)
    first, second, third = [await plan.take() for _ in range(3)]
    assert first is not None
    assert second is not None
    assert third is not None
    assert [planned.task.id for planned in (first, second, third)] == ["t0", "t1", "t3"]
    assert await plan.take(wait=False) is None
    waiting = asyncio.create_task(plan.take())
    await asyncio.sleep(0)
    await plan.leave(third)
    await asyncio.sleep(0)
    assert not waiting.done()
    await plan.leave(first)  # its browser is given back; its verdict may take a while
    last = await waiting
    assert last is not None
    assert last.task.id == "t2"
    for planned in (first, second, third, last):
        await plan.settle(planned, Outcome.SUCCESS)
    assert await plan.take() is None
