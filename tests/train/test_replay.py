"""Each rule of the replay, its counts, and that draws are what the seed says."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import msgspec
import pytest
from tests.train.making import Made, step, task, trajectory

from webgym.core.action import Answer
from webgym.core.errors import ConfigError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Reply, Trajectory
from webgym.train.config import ReplayConfig
from webgym.train.objectives import FilteredBC, GroupIS
from webgym.train.replay import Counts, Replay, ReplaySample

SUCCESS, FAILURE = Outcome.SUCCESS, Outcome.FAILURE


def replay(objective: FilteredBC | GroupIS | None = None, seed: int = 0, **settings: object) -> Replay:
    return Replay(ReplayConfig.model_validate(settings), objective or FilteredBC(), seed=seed)


def drawn(which: Replay) -> list[tuple[int, str, int]]:
    return [(ref.iteration, ref.attempt_id, ref.index) for ref in which.draw().steps]


def test_only_trajectories_with_a_reward_and_of_those_only_successes() -> None:
    run = Made([trajectory(number, outcome=each) for number, each in enumerate(Outcome)])
    made = replay()

    counts = made.add(0, run)

    assert {attempt for _, attempt, _ in drawn(made)} == {"t/a#0.0"}
    assert (counts.trajectories, counts.unrewarded, counts.left_out, counts.kept) == (8, 5, 2, 1)


def test_a_step_that_changed_nothing_is_dropped_and_the_answer_is_kept() -> None:
    run = Made([trajectory(changed=(True, False, True))])
    made = replay()

    counts = made.add(0, run)

    assert [index for _, _, index in drawn(made)] == [0, 2, 3]
    assert (counts.steps, counts.unchanged, counts.kept_steps) == (4, 1, 3)


def test_without_the_repetition_penalty_it_is_kept() -> None:
    made = replay(repetition_penalty=False)
    made.add(0, Made([trajectory(changed=(True, False))]))
    assert len(drawn(made)) == 3


def test_an_answer_is_kept_even_if_somebody_looked_after_it_and_saw_the_same() -> None:
    one = trajectory(changed=())
    steps = (step(0, action=Answer("4"), changed=False),)

    same = msgspec.structs.replace(one, episode=msgspec.structs.replace(one.episode, steps=steps))
    made = replay()
    made.add(0, Made([same]))
    assert len(drawn(made)) == 1


def unreadable(number: int = 0, *, changed: bool, outcome: Outcome = SUCCESS) -> Trajectory:
    """A reply without an action, then an answer."""
    one = trajectory(number, changed=(True,), outcome=outcome)
    steps = (step(0, action=None, changed=changed), one.episode.steps[1])
    return msgspec.structs.replace(one, episode=msgspec.structs.replace(one.episode, steps=steps))


@pytest.mark.parametrize("changed", [True, False])
@pytest.mark.parametrize("penalty", [True, False])
def test_a_reply_without_an_action_is_dropped_whatever_the_page_did(*, changed: bool, penalty: bool) -> None:
    made = replay(repetition_penalty=penalty)
    counts = made.add(0, Made([unreadable(changed=changed)]))
    assert [index for _, _, index in drawn(made)] == [1]
    assert (counts.steps, counts.unreadable, counts.unchanged, counts.kept_steps) == (2, 1, 0, 1)


def test_a_reply_without_an_action_may_be_blamed() -> None:
    made = replay(GroupIS())
    won, lost = (
        unreadable(number, changed=True, outcome=each) for number, each in enumerate([SUCCESS, FAILURE])
    )
    counts = made.add(0, Made([won, lost]))
    assert drawn(made) == [(0, "t/a#0.0", 1), (0, "t/a#1.0", 0), (0, "t/a#1.0", 1)]
    assert (counts.steps, counts.unreadable, counts.kept_steps) == (4, 1, 3)


def runs(iterations: int, size: int) -> list[Made]:
    return [Made([trajectory(each, changed=()) for each in range(size)]) for number in range(iterations)]


def test_iterations_older_than_the_last_k_are_forgotten() -> None:
    made = replay(iterations=2)
    for number, run in enumerate(runs(4, 1)):
        made.add(number, run)
    assert {iteration for iteration, _, _ in drawn(made)} == {2, 3}


def test_newer_steps_are_drawn_by_the_formula() -> None:
    """With few draws from many steps, shares are as the weights 16 : 9 : 4 : 1."""
    found: Counter[int] = Counter()
    folders = runs(4, 40)
    for seed in range(150):
        made = replay(seed=seed, steps=4, max_uses=None)
        for number, run in enumerate(folders):
            made.add(number, run)
        found.update(3 - iteration for iteration, _, _ in drawn(made))

    total = sum(found.values())
    for age, weight in enumerate((16, 9, 4, 1)):
        assert found[age] / total == pytest.approx(weight / 30, abs=0.06)


def test_a_draw_has_as_many_steps_as_asked_for_each_once() -> None:
    made = replay(steps=7)
    made.add(0, Made([trajectory(each) for each in range(5)]))
    chosen = drawn(made)
    assert len(chosen) == len(set(chosen)) == 7


def test_a_step_that_was_used_often_enough_leaves() -> None:
    made = replay(passes=2, max_uses=4)
    folders = runs(3, 5)
    used: Counter[tuple[int, str, int]] = Counter()
    for number, run in enumerate(folders):
        made.add(number, run)
        draw = made.draw()
        used.update({(ref.iteration, ref.attempt_id, ref.index): 2 for ref in draw.steps})
    assert max(used.values()) == 4
    assert draw.used_up == 5  # those of iteration 0
    assert draw.by_age == {0: 5, 1: 5}


def test_the_same_seed_draws_the_same_whatever_order_trajectories_ended_in() -> None:
    made = [trajectory(each) for each in range(8)]
    folders = [Made(made), Made(made[::-1])]
    choices = []
    for run, seed in [(folders[0], 1), (folders[1], 1), (folders[0], 2)]:
        each = replay(seed=seed, steps=6)
        each.add(0, run)
        choices.append(drawn(each))
    assert choices[0] == choices[1] != choices[2]


def test_a_resumed_replay_goes_on_as_the_first_would_have() -> None:
    folders = runs(3, 6)
    first, again = replay(steps=4), replay(steps=4)
    draws = []
    for number, run in enumerate(folders):
        first.add(number, run)
        draws.append(first.draw())
    for number, run in enumerate(folders):
        again.add(number, run)
        if number < 2:
            again.use(draws[number].steps)
    assert again.draw() == draws[2]


def test_attempts_at_a_task_that_was_drawn_twice_are_two() -> None:
    made = replay()
    made.add(0, Made([trajectory(0, changed=()), trajectory(1, changed=())]))
    assert drawn(made) == [(0, "t/a#0.0", 0), (0, "t/a#1.0", 0)]


def test_a_run_folder_reads_the_same(tmp_path: Path) -> None:
    run = Made([trajectory(0), trajectory(1, outcome=FAILURE)])
    made, again = replay(), replay()
    assert made.add(0, run) == again.add(0, run.write(tmp_path))
    assert made.draw() == again.draw()


def test_nothing_to_learn_from_is_an_empty_draw() -> None:
    made = replay()
    made.add(0, Made([trajectory(outcome=FAILURE)]))
    assert made.draw().steps == ()


@pytest.mark.parametrize("outcome", [SUCCESS, FAILURE, Outcome.BLOCKED])
def test_a_test_task_is_refused_whatever_became_of_it(outcome: Outcome) -> None:
    run = Made([trajectory(outcome=outcome)], [task(split="test")])
    with pytest.raises(ConfigError, match="t/a is a test task"):
        replay().add(0, run)


def test_a_training_task_that_leaks_a_test_task_of_its_run_is_refused() -> None:
    test = msgspec.structs.replace(task(split="test"), id="t/test")
    run = Made([trajectory(outcome=FAILURE)], [task(), test])
    with pytest.raises(ConfigError, match=r"t/a on .* shares the (website|family) of the test task"):
        replay().add(0, run)


def kinds(counts: Counts) -> dict[str, float]:
    """Numbers of groups."""
    return {kind: share * counts.group_count for kind, share in counts.groups.items() if share}


def group(of: str, *rewards: int) -> list[Trajectory]:
    return [
        trajectory(number, of=of, outcome=SUCCESS if reward else FAILURE, changed=())
        for number, reward in enumerate(rewards)
    ]


def test_groups_without_a_difference_are_left_out_and_the_rest_have_a_baseline() -> None:
    run = Made([*group("all", 1, 1), *group("none", 0, 0), *group("one", 1), *group("some", 1, 0, 0, 0)])
    made = replay(GroupIS())
    counts = made.add(0, run)

    steps = made.draw().steps
    assert [ref.attempt_id for ref in steps] == [f"t/some#{number}.0" for number in range(4)]
    assert [ref.advantage for ref in steps] == pytest.approx([0.15, -0.05, -0.05, -0.05])
    assert (counts.left_out, counts.kept) == (5, 4)
    assert kinds(counts) == {"all_right": 1, "all_wrong": 1, "mixed": 1}
    assert made.mixed_trajectories() == 4


def test_a_group_with_a_straggler_that_was_cut_off_has_no_baseline() -> None:
    cut = trajectory(3, of="cut", outcome=Outcome.CANCELLED)
    lost = trajectory(3, of="lost", outcome=Outcome.ENVIRONMENT_ERROR)
    run = Made([*group("cut", 1, 0, 0), cut, *group("lost", 1, 0, 0), lost])
    made = replay(GroupIS())
    counts = made.add(0, run)
    assert {attempt for _, attempt, _ in drawn(made)} == {f"t/lost#{number}.0" for number in range(3)}
    assert kinds(counts) == {"cut_off": 1, "mixed": 1}
    cloned = replay(FilteredBC())
    cloned.add(0, run)
    assert {attempt for _, attempt, _ in drawn(cloned)} == {"t/cut#0.0", "t/lost#0.0"}


def test_a_group_that_ends_late_is_used_once_it_is_whole() -> None:
    run = Made(group("late", 1, 0, 0))
    early = Made(group("late", 1, 0))
    early.drawn = run.drawn
    made = replay(GroupIS(), max_uses=1, passes=1)
    assert kinds(made.add(0, early, is_over=False)) == {"cut_off": 1}
    assert (made.mixed_trajectories(), drawn(made)) == (0, [])
    made.add(1, Made(group("other", 1, 0)))
    made.add(0, run)
    assert made.mixed_trajectories() == 5
    assert len(drawn(made)) == 5
    assert (made.mixed_trajectories(), drawn(made)) == (0, [])


def test_an_attempt_that_is_made_again_is_not_lost_yet() -> None:
    lost = trajectory(2, of="a", outcome=Outcome.ENVIRONMENT_ERROR)
    run, made = Made([*group("a", 1, 0), lost]), replay(GroupIS())
    assert kinds(made.add(0, run, is_over=False)) == {"cut_off": 1}
    assert kinds(made.add(0, run)) == {"mixed": 1}


def test_whole_trajectories_are_drawn() -> None:
    made = replay(GroupIS(), trajectories=3, max_uses=None)
    run = [trajectory(number, outcome=FAILURE if number % 2 else SUCCESS) for number in range(6)]
    made.add(0, Made(run))
    draw = made.draw()
    assert Counter(ref.attempt_id for ref in draw.steps).most_common() == [
        (attempt, 3) for attempt in sorted({ref.attempt_id for ref in draw.steps})
    ]
    assert (draw.trajectories, len(draw.steps), draw.earlier_uses) == (3, 9, 0.0)


def test_a_group_that_failed_gets_an_earlier_success_at_its_task() -> None:
    made = replay(GroupIS(staleness=0), rescue=True, passes=1, max_uses=2)
    assert made.add(1, Made(group("a", 1, 0))).rescued == 0
    assert made.add(2, Made(group("b", 0, 0))).rescued == 0
    assert made.draw().steps == ()
    counts = made.add(5, Made([*group("a", 0, 0, 0), *group("b", 0, 0)]))
    draw = made.draw()
    assert [(ref.iteration, ref.attempt_id) for ref in draw.steps] == [
        (1, "t/a#0.0"),
        *((5, f"t/a#{number}.0") for number in range(3)),
    ]
    assert [ref.advantage for ref in draw.steps] == pytest.approx([0.15, -0.05, -0.05, -0.05])
    assert (counts.rescued, counts.kept, counts.left_out) == (1, 4, 2)
    assert kinds(counts) == {"all_wrong": 2}


def test_a_step_that_changed_nothing_is_not_reinforced_but_may_be_blamed() -> None:
    won, lost = (
        trajectory(number, outcome=each, changed=(False,)) for number, each in enumerate([SUCCESS, FAILURE])
    )
    made = replay(GroupIS())
    counts = made.add(0, Made([won, lost]))
    assert drawn(made) == [(0, "t/a#0.0", 1), (0, "t/a#1.0", 0), (0, "t/a#1.0", 1)]
    assert (counts.steps, counts.unchanged) == (4, 1)


def test_an_objective_bounds_how_stale_a_step_may_be() -> None:
    made = replay(GroupIS(staleness=1))
    for number in range(3):
        made.add(number, Made(group("a", 1, 0)))
    assert {iteration for iteration, _, _ in drawn(made)} == {1, 2}


# --- staleness ---------------------------------------------------------------------------------------------


def made_by(*versions: str) -> Made:
    """One group of two attempts, whose steps were made by these weights."""
    won, lost = trajectory(0, changed=[True] * len(versions)), trajectory(1, outcome=FAILURE)
    steps = [
        msgspec.structs.replace(each, reply=Reply("click", "p", weight_version=version))
        for each, version in zip(won.episode.steps, (*versions, versions[-1]), strict=True)
    ]
    episode = msgspec.structs.replace(won.episode, steps=tuple(steps))
    return Made([msgspec.structs.replace(won, episode=episode), lost])


def of_winner(draw: ReplaySample) -> list[int]:
    return [ref.index for ref in draw.steps if ref.attempt_id == "t/a#0.0"]


def test_staleness_is_that_of_the_weights_that_made_each_step() -> None:
    """Collected while weights changed: the iteration is the newest, two of its steps are too old."""
    made = replay(GroupIS(staleness=1))
    for version in ("1", "2", "3"):
        made.publish(version)
    made.add(4, made_by("1", "2", "3", "no such"))

    draw = made.draw()

    assert of_winner(draw) == [1, 2]
    assert draw.stale == 3, "the first, the one of nobody knows whom, and the answer after it"
    assert draw.by_staleness == {0: 1, 1: 1}
    assert [ref.version for ref in draw.steps if ref.attempt_id == "t/a#0.0"] == ["2", "3"]


def test_iterations_without_an_update_make_nothing_stale() -> None:
    made = replay(GroupIS(staleness=0))
    made.publish("3")  # 1 and 2 had nothing to learn from
    made.publish("7")
    made.add(8, made_by("3", "7"))
    assert of_winner(made.draw()) == [1, 2]


def test_what_does_not_say_its_weights_is_as_old_as_its_iteration() -> None:
    made = replay(GroupIS(staleness=1), iterations=4)
    for iteration in (1, 2, 3):
        made.add(iteration, Made([trajectory(0), trajectory(1, outcome=FAILURE)]))
    assert {ref.iteration for ref in made.draw().steps} == {2, 3}


def test_the_papers_objective_bears_any_staleness() -> None:
    made = replay(FilteredBC())
    made.publish("1")
    made.publish("2")
    made.add(3, made_by("0", "0", "2"))
    draw = made.draw()
    assert (len(draw.steps), draw.stale) == (4, 0)
    assert draw.by_staleness == {0: 2, 2: 2}


@pytest.mark.parametrize("objective", [FilteredBC(), GroupIS()])
def test_what_was_not_rewarded_is_trained_on_by_no_objective(objective: FilteredBC | GroupIS) -> None:
    """Not even as a failure: a fault is no evidence against what was done."""
    made = replay(objective)
    made.add(0, Made([trajectory(number, outcome=each) for number, each in enumerate(Outcome)]))
    trained = {attempt for _, attempt, _ in drawn(made)}
    rewarded = {f"t/a#{number}.0" for number, each in enumerate(Outcome) if each.is_rewarded}
    assert trained <= rewarded
