"""A run's judges beside people's labels of it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from tests.judge.test_agreement import Command, command  # noqa: F401 - a fixture
from tests.report.conftest import build_run

from webgym.core.outcome import Outcome
from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import FactJudgement, Judgement, Verdict
from webgym.judge.base import Pictures
from webgym.judge.labels import HumanLabel, annotator_agreement
from webgym.judge.panel import PREFIX, WithoutRubric
from webgym.results.labels import LabelStore, labels_path, pairs_of, resolved
from webgym.rollout.rejudge import judge_run
from webgym.store.runs import RECORDED, RunReader

NO = Judgement(False, "no")


class Answered:
    """Passes whatever was answered, each fact of the rubric that it is given."""

    name = "answered/1"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        assert task.rubric == WHOLE_TASK
        assert task.truth is None
        facts = [
            FactJudgement(group.id, index, fact, Judgement(True, "seen"))
            for group, index, fact in task.rubric.facts()
        ]
        return Verdict(self.name, int(episode.answer is not None), tuple(facts), NO)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dozen attempts, judged when they were collected and once more without rubric."""
    path = asyncio.run(build_run(tmp_path_factory.mktemp("runs") / "run", 12))
    asyncio.run(judge_run(path, WithoutRubric(Answered())))
    return path


def by_outcome(run: Path) -> dict[Outcome, list[str]]:
    found: dict[Outcome, list[str]] = {}
    for entry in RunReader(run).attempts.values():
        found.setdefault(entry.outcome, []).append(entry.attempt_id)
    return found


def test_every_label_is_a_case_or_is_counted(run: Path) -> None:
    ended = by_outcome(run)
    (blocked,), (unjudged,), (crashed,) = (
        ended[outcome] for outcome in (Outcome.BLOCKED, Outcome.JUDGE_ERROR, Outcome.ENVIRONMENT_ERROR)
    )
    first, second, third, fourth, *_ = ended[Outcome.SUCCESS]
    task_id = RunReader(run).attempts[second].task_id
    labels = [
        HumanLabel("success", first, annotator="ann"),
        HumanLabel("failure", task_id=task_id, annotator="ann"),
        HumanLabel("success", third, annotator="ann"),
        HumanLabel("failure", third, annotator="bob"),
        HumanLabel("unsure", fourth, annotator="ann"),
        HumanLabel("failure", blocked),
        HumanLabel("success", unjudged),
        HumanLabel("failure", crashed),
        HumanLabel("success", "gone#0.0"),
    ]
    pairs = pairs_of(run, [RECORDED, PREFIX], labels)
    assert pairs.judges == (RECORDED, f"{PREFIX}answered/1")
    assert {(case.human, case.verdicts) for case in pairs.cases} == {
        (True, (True, True)),
        (False, (True, True)),
        (False, (False, False)),  # blocked: it did not succeed
        (True, (None, True)),  # one judge came to no verdict
    }
    assert all(case.level is not None and case.task for case in pairs.cases)
    assert pairs.left_out == {
        "the annotators do not agree": 1,
        "the annotators are unsure": 1,
        "not judged by every judge": 1,
        "a label of an attempt that is not in the run": 1,
    }
    first_labels = pairs_of(run, [RECORDED], labels, "first")
    assert len(first_labels.cases) == 5


def test_a_label_by_task_and_one_by_attempt_are_one_persons(run: Path) -> None:
    reader = RunReader(run)
    attempt, other = by_outcome(run)[Outcome.SUCCESS][:2]
    tasks = [reader.attempts[attempt_id].task_id for attempt_id in (attempt, other)]
    labels = [
        HumanLabel("failure", task_id=tasks[0], annotator="ann"),
        HumanLabel("failure", other, annotator="bob"),
        HumanLabel("success", attempt, annotator="ann"),
        HumanLabel("success", task_id=tasks[1], annotator="ann"),
    ]
    pairs = pairs_of(run, [RECORDED], labels, "first")
    assert [case.human for case in pairs.cases] == [True, False]  # the later label of ann, the first of bob
    assert pairs.left_out == {"a label that the same person gave again": 1}
    people = annotator_agreement(resolved(reader, labels))
    assert (people.attempts, people.observed) == (1, 0.0)
    assert [pair.pair for pair in people.pairs] == [("ann", "bob")]


def test_labels_of_other_agents_runs_are_not_of_ours(
    run: Path,
    command: Command,  # noqa: F811
    tmp_path: Path,
) -> None:
    attempt = by_outcome(run)[Outcome.SUCCESS][0]
    file = tmp_path / "human_label.json"
    record = {"task_id": RunReader(run).attempts[attempt].task_id}
    file.write_text(json.dumps([record | {"SeeAct_human_label": "0", "Ours_human_label": "1"}]))
    options = (run, "--labels", file, "--judge", "recorded", "--json")
    code, said = command(*options)
    assert code == 2
    assert "2 × a label of another agent's run" in said
    code, said = command(*options, "--agent", "Ours")
    assert code == 0, said
    told = json.loads(said)
    assert told["successes"]["overall"] == told["cases"]["overall"] == 1
    assert told["left_out"] == {"a label of another agent's run": 1}


def test_the_command_on_labels_of_the_labelling_page(
    run: Path,
    command: Command,  # noqa: F811
    tmp_path: Path,
) -> None:
    book = LabelStore(labels_path(run))
    ended = by_outcome(run)
    for outcome in (Outcome.SUCCESS, Outcome.FAILURE, Outcome.TRUNCATED):
        for attempt_id in ended[outcome]:
            label = "success" if outcome is Outcome.SUCCESS else "failure"
            book.put(HumanLabel(label, attempt_id, annotator="ann"))  # type: ignore[arg-type]
    book.put(HumanLabel("failure", ended[Outcome.SUCCESS][0], annotator="bob"))

    named = ("--judge", "recorded=ours", "--judge", f"{PREFIX}answered=ours")
    code, said = command(run, "--annotator", "ann", *named, "--figure", tmp_path / "f.svg", "--json")
    assert code == 0, said
    told = json.loads(said)
    assert list(told["judges"]) == ["ours", f"{PREFIX}ours"]
    assert told["judges"]["ours"]["overall"]["metrics"]["accuracy"]["value"] == 1.0
    assert told["judges"][f"{PREFIX}ours"]["overall"]["confusion"] == {
        "both": 4,
        "judge_only": 2,
        "human_only": 0,
        "neither": 1,
    }
    assert told["annotators"]["attempts"] == 1
    assert (tmp_path / "f.svg").stat().st_size > 10_000

    code, said = command(run)
    assert code == 0, said
    assert "6 of 7 labelled trajectories compared, 3 of them labelled as successes" in said
    assert "left out: 1 × the annotators do not agree" in said
    assert "annotators: 1 shared attempts" in said
    for options, why in (
        ((run, "--annotator", "eve"), "no labels of 'eve'"),
        ((run, "--judge", "nobody"), "no judge"),
        ((run, "--labels", tmp_path / "none.csv"), "No such file or directory (label traj"),
        ((run, "--humans", "best"), "majority"),
    ):
        code, said = command(*options)
        assert code == 2
        assert why in said
