"""The figures of a run."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.action import Wait
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Failure, Reply, Step, Trajectory
from webgym.core.verdict import Judgement, Verdict
from webgym.results.rates import wilson
from webgym.results.summary import quantiles, summarise

SEEN = Observation("0" * 64, "http://a.test/", "A", (1280, 768), milliseconds={"screenshot": 40.0})
VERDICT = Verdict("offline-1", 1, (), Judgement(False, "no"))


def task(id_: str, facts: int, domain: str = "Shopping", website: str = "http://a.test/") -> Task:
    rubric = Rubric((FactGroup(1, "all", tuple(f"fact {number}" for number in range(facts))),))
    return Task(id_, "Do it", website, domain, "Books", rubric, "offline")


TASKS = [task("e", 1), task("m", 5), task("h", 8, "Travel", "http://b.test/")]
_numbers = itertools.count()


def attempt(
    task_id: str,
    outcome: Outcome,
    *,
    steps: int = 2,
    started: float = 0.0,
    seconds: float = 10.0,
    failure: Failure | None = None,
) -> Trajectory:
    number = next(_numbers)
    taken = tuple(Step(i, SEEN, (), Reply("r", "p", seconds=0.5), at=i * 2.0) for i in range(steps))
    judged = outcome in (Outcome.SUCCESS, Outcome.FAILURE, Outcome.TRUNCATED, Outcome.BLOCKED)
    return Trajectory(
        Episode(
            attempt_id=f"{task_id}#{number}.0",
            task_id=task_id,
            sample=number,
            retry=0,
            seed=1,
            policy="scripted",
            started_at=started,
            seconds=seconds,
            steps=taken,
            ending=Ending.ANSWERED,
            failure=failure,
        ),
        outcome,
        VERDICT if judged else None,
        judge_seconds=0.25 if judged else 0.0,
    )


def test_outcomes_add_up_and_only_rewarded_ones_enter_the_rate() -> None:
    given_ = [attempt("e", outcome) for outcome in Outcome] + [attempt("e", Outcome.SUCCESS)]
    summary = summarise(given_, TASKS, seed=7)
    assert summary["attempts"] == 9 == sum(summary["outcomes"].values())
    assert set(summary["outcomes"]) == {outcome.value for outcome in Outcome}
    assert summary["success_rate"] == {"overall": 0.5, "easy": 0.5, "medium": None, "hard": None}
    assert summary["success_interval"]["medium"] is None
    assert summary["success_interval"]["overall"] == pytest.approx((0.150, 0.850), abs=1e-3)
    assert (summary["policy"], summary["judge"], summary["seed"]) == ("scripted", "offline-1", 7)


def test_what_leaves_the_rate_of_judged_attempts_does_not_leave_that_of_planned_ones() -> None:
    kept = [attempt("e", Outcome.SUCCESS), attempt("m", Outcome.FAILURE)]
    lost = [attempt("m", outcome) for outcome in (Outcome.BLOCKED, Outcome.JUDGE_ERROR)]
    summary = summarise([*kept, *lost], TASKS, 3)
    assert summary["success_rate"] == {"overall": 0.5, "easy": 1.0, "medium": 0.0, "hard": None}
    assert summary["planned"] == {"overall": 9, "easy": 3, "medium": 3, "hard": 3}
    of_planned = summary["success_rate_of_planned"]
    assert of_planned == {"overall": 1 / 9, "easy": 1 / 3, "medium": 0.0, "hard": 0.0}
    assert summary["success_interval_of_planned"]["overall"] == wilson(1 / 3, 3)  # of 3 tasks
    assert summary["by_domain"]["Shopping"]["success_rate_of_planned"] == 1 / 6
    assert summary["by_website"]["http://a.test/"]["planned"] == 6


def test_a_sample_that_is_attempted_again_was_planned_once() -> None:
    tries = [attempt("e", Outcome.ENVIRONMENT_ERROR), attempt("e", Outcome.SUCCESS)]
    again = [
        msgspec.structs.replace(each, episode=msgspec.structs.replace(each.episode, sample=0))
        for each in tries
    ]
    summary = summarise(again, TASKS[:1])
    assert (summary["attempts"], summary["planned"]["overall"]) == (2, 1)
    assert summary["success_rate_of_planned"]["easy"] == 1.0


def test_a_task_that_was_drawn_twice_was_planned_twice() -> None:
    summary = summarise([attempt("e", Outcome.SUCCESS)], [TASKS[0], TASKS[0]])
    assert summary["planned"]["easy"] == 2
    assert summary["success_rate_of_planned"]["overall"] == 0.5


def test_groups_are_of_the_tasks() -> None:
    summary = summarise(
        [
            attempt("e", Outcome.SUCCESS),
            attempt("m", Outcome.FAILURE, steps=6),
            attempt("h", Outcome.SUCCESS),
        ],
        TASKS,
    )
    assert summary["tasks"] == 3
    assert summary["by_level"]["medium"]["success_rate"] == 0.0
    assert summary["by_level"]["medium"]["steps_per_attempt"]["p50"] == 6
    assert summary["by_domain"]["Shopping"]["attempts"] == 2
    assert summary["by_domain"]["Travel"]["success_rate"] == 1.0
    assert summary["by_website"]["http://a.test/"]["steps"] == 8


def test_a_task_that_the_run_does_not_hold_is_still_counted() -> None:
    summary = summarise([attempt("other", Outcome.SUCCESS)], TASKS)
    assert summary["success_rate"]["overall"] == 1.0
    assert summary["by_domain"]["unknown"]["attempts"] == 1


def test_times_are_what_they_say() -> None:
    summary = summarise([attempt("e", Outcome.SUCCESS, steps=3)], TASKS)
    assert summary["step_milliseconds"] == {"count": 2, "p50": 1500.0, "p95": 1500.0}  # 2 s less the reply
    assert summary["operation_milliseconds"] == {
        "judge": {"count": 1, "p50": 250.0, "p95": 250.0},
        "policy": {"count": 3, "p50": 500.0, "p95": 500.0},
        "screenshot": {"count": 3, "p50": 40.0, "p95": 40.0},
    }


def test_a_pause_between_two_parts_of_a_run_is_no_wall_time() -> None:
    parts = [(0.0, 10.0), (4.0, 10.0), (5.0, 2.0), (1000.0, 6.0)]
    attempts = [attempt("e", Outcome.SUCCESS, started=start, seconds=seconds) for start, seconds in parts]
    summary = summarise(attempts, TASKS)
    assert summary["wall_seconds"] == pytest.approx(20.0)
    assert summary["steps_per_second"] == pytest.approx(8 / 20)
    assert summarise(attempts, TASKS, wall_seconds=40.0)["steps_per_second"] == pytest.approx(8 / 40)


def test_losses_are_grouped_by_code_and_rewarded_attempts_are_none() -> None:
    crash = Failure("browser_crashed", "the renderer is gone")
    summary = summarise(
        [
            attempt("e", Outcome.POLICY_ERROR, failure=Failure("policy_timeout", "no reply")),
            attempt("e", Outcome.ENVIRONMENT_ERROR, failure=crash),
            attempt("m", Outcome.ENVIRONMENT_ERROR, failure=crash),
            attempt("m", Outcome.TRUNCATED, failure=crash),
            attempt("h", Outcome.BLOCKED),
        ],
        TASKS,
    )
    assert list(summary["losses"]) == ["browser_crashed", "policy_timeout", "blocked"]
    assert summary["losses"]["blocked"]["message"] == VERDICT.blocked.reason
    assert summary["losses"]["browser_crashed"]["count"] == 2
    assert summary["losses"]["browser_crashed"]["outcomes"] == {"environment_error": 2}
    assert summary["losses"]["browser_crashed"]["message"] == "the renderer is gone"


def test_replies_without_an_action_are_counted_and_many_are_said() -> None:
    unread = attempt("e", Outcome.TRUNCATED, steps=3)
    acted = msgspec.structs.replace(
        unread,
        episode=msgspec.structs.replace(
            unread.episode,
            sample=99,
            attempt_id="e#99.0",
            policy="m",
            steps=tuple(msgspec.structs.replace(step, action=Wait(1)) for step in unread.episode.steps) * 20,
        ),
    )
    few = summarise([acted, attempt("e", Outcome.FAILURE, steps=1)], TASKS)
    assert (few["invalid_replies"], few["notes"][1:]) == (1, [])
    assert few["invalid_reply_rate"] == pytest.approx(1 / 61)
    assert summarise([], TASKS)["invalid_reply_rate"] is None
    many = summarise([acted, *(attempt("e", Outcome.FAILURE, steps=1) for _ in range(9))], TASKS)
    assert many["invalid_replies"] == 9
    assert "13.0% of 69 replies hold no valid action; the first: " in many["notes"][-1]
    (step,) = attempt("e", Outcome.FAILURE, steps=1).episode.steps
    backwards = msgspec.structs.replace(step, parse_error="no action in \u202e\x1b[2J")
    episode = msgspec.structs.replace(unread.episode, steps=(backwards,))
    note = summarise([msgspec.structs.replace(unread, episode=episode)], TASKS)["notes"][-1]
    assert "; the first: no action in \ufffd\ufffd[2J (" in note, "a reply cannot turn our own words round"


def test_a_sample_that_errors_took_is_lost_until_an_attempt_at_it_counts() -> None:
    first = attempt("e", Outcome.ENVIRONMENT_ERROR)
    again = msgspec.structs.replace(
        first,
        outcome=Outcome.FAILURE,
        episode=msgspec.structs.replace(first.episode, retry=1, attempt_id="again"),
    )
    assert summarise([first], TASKS)["lost_samples"] == 1
    assert summarise([again, first], TASKS)["lost_samples"] == 0


def test_nothing_at_all() -> None:
    summary = summarise([], [])
    assert summary["attempts"] == 0
    assert summary["success_rate"]["overall"] is None
    assert summary["steps_per_second"] == 0.0
    assert msgspec.json.decode(msgspec.json.encode(summary))["losses"] == {}


def test_trajectories_are_not_held() -> None:
    alive = 0

    class Counted(Trajectory, frozen=True):
        def __del__(self) -> None:
            nonlocal alive
            alive -= 1

    def stream() -> Iterator[Trajectory]:
        nonlocal alive
        for _ in range(50):
            made = attempt("e", Outcome.SUCCESS)
            alive += 1
            assert alive <= 2
            yield Counted(made.episode, made.outcome)

    assert summarise(stream(), TASKS)["attempts"] == 50


@given(st.integers(0, 200), st.integers(0, 200))
def test_the_interval_holds_the_rate(successes: int, failures: int) -> None:
    interval = wilson(successes, successes + failures)
    if successes + failures == 0:
        assert interval is None
    else:
        assert interval is not None
        low, high = interval
        assert 0.0 <= low <= successes / (successes + failures) + 1e-12
        assert successes / (successes + failures) - 1e-12 <= high <= 1.0


def test_known_quantiles_and_interval() -> None:
    assert quantiles([4, 1, 2, 3]) == {"count": 4, "p50": 2.5, "p95": pytest.approx(3.85)}
    assert wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)


def test_verdicts_of_several_judges_are_told() -> None:
    won, lost = attempt("e", Outcome.SUCCESS), attempt("m", Outcome.FAILURE)
    verdict = msgspec.structs.replace(VERDICT, judge="offline-2", reward=0)
    summary = summarise([won, msgspec.structs.replace(lost, verdict=verdict)], TASKS, judge="offline-2")
    assert summary["judge"] == "offline-1, offline-2"
    assert "attempts were judged by different judges: offline-1, offline-2" in summary["notes"]
    assert summarise([], TASKS, judge="offline-2")["judge"] == "offline-2"
