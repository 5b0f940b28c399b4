"""A full offline run, judged by the offline judge and, through a real endpoint, by the rubric judge."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from tests.judge.judge_model import Asked, serve_judge

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.text import fold, says
from webgym.judge.config import JudgeChoice
from webgym.judge.factory import open_judge
from webgym.judge.offline import OfflineJudge, items
from webgym.judge.offline import compare as answer_check
from webgym.llm.cache import ReplyCache
from webgym.llm.ledger import Ledger
from webgym.llm.prices import Prices
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import CollectorConfig
from webgym.rollout.rejudge import compare_judges, judge_run
from webgym.run.collect import collect
from webgym.run.config import PolicyChoice, RunConfig, TaskChoice
from webgym.store.runs import RECORDED, RunReader, verdicts_of
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw

pytestmark = pytest.mark.browser

SITES = SitesConfig(per_family=3, latency=0)


class Reader:
    """A judge model that reads what the screenshots of a run say, and knows what proves which fact."""

    def __init__(self, tasks: Mapping[str, Task], texts: Mapping[str, str]) -> None:
        self.tasks = {task.instruction: task for task in tasks.values()}
        self.texts = texts

    def __call__(self, asked: Asked) -> str:
        if asked.stage == "blocking":
            return asked.verdict(False, "The last page is an ordinary one.")
        task = self.tasks[asked.quotes["task"]]
        assert task.truth is not None
        shown = {label: fold(self.texts[name]) for label, name in asked.shots}
        by_fact = {
            text: [
                evidence.texts
                for known in task.truth.facts
                if (known.group, known.index) == (group.id, index)
                for evidence in known.evidence
            ]
            for group, index, text in task.rubric.facts()
        }
        if asked.stage == "keypoint":
            proofs = [texts for evidence in by_fact.values() for texts in evidence]
            return asked.each(lambda name: self._matters(fold(self.texts[name]), proofs))
        if asked.stage == "fact":
            proofs = by_fact[asked.quotes["fact"]]
            where = [
                label for label, seen in shown.items() if any(self._shows(seen, texts) for texts in proofs)
            ]
            # What only the website's server knows is not to be seen.
            passed = bool(where) or not proofs
            return asked.verdict(passed, f"It stands at {where[0]}." if where else "No screenshot shows it.")
        if asked.stage == "response":
            known = fold(" ".join(option for options in task.truth.answer.values for option in options))
            given = items(asked.quotes["answer"])
            invented = [
                each for each in given if not any(says(text, each) for text in (known, *shown.values()))
            ]
            return asked.verdict(
                not invented, f"Not visible: {invented}." if invented else "All of it is visible."
            )
        _, value = answer_check(task.truth.answer, asked.quotes["answer"])
        return asked.verdict(bool(value and value.passed))

    def _matters(self, seen: str, proofs: list[tuple[str, ...]]) -> bool:
        """When in doubt, yes: a number may be what the answer needs."""
        return any(self._shows(seen, texts) for texts in proofs) or bool(re.search("[0-9]{2}", seen))

    @staticmethod
    def _shows(seen: str, texts: tuple[str, ...]) -> bool:
        return all(says(seen, text) for text in texts)


async def make_run(path: Path) -> Path:
    web = OfflineWeb(SITES.seed, per_family=SITES.per_family)
    hosts = [host for host, spec in web.specs.items() if spec.behaviour == "good"]
    short = [
        task
        for host in hosts
        for task in web.tasks_of(host)
        if task.truth is not None and len(task.truth.moves) <= 6
    ]
    write_tasks(path / "tasks.jsonl", draw(short, 6, 5))
    config = RunConfig(
        sites=SITES,
        tasks=TaskChoice(file=path / "tasks.jsonl", split="all"),
        policy=PolicyChoice(mistakes=0.5),
        collector=CollectorConfig(sessions=2),
        retries=0,
    )
    await collect(config, path / "run")
    return path / "run"


async def test_a_run_is_judged_by_both_judges_with_costs(tmp_path: Path) -> None:
    run = await make_run(tmp_path)
    reader = RunReader(run)
    texts: dict[str, str] = {}
    for trajectory in reader.trajectories():
        for seen in trajectory.episode.observations:
            texts[seen.screenshot] = seen.text or ""
    before = (run / "trajectories/00000.jsonl").read_bytes(), (run / "summary.json").read_bytes()

    async with (
        serve_judge(Reader(reader.tasks, texts)) as model,
        ReplyCache(tmp_path / "replies.sqlite") as cache,
    ):
        ledger = Ledger(cache, prices=Prices.parse("2,8"))
        choice = JudgeChoice(name="rubric", rubric=model.config())
        async with open_judge(choice, cache=cache, ledger=ledger) as judge:
            state = await judge_run(run, judge)
            asked = len(model.asked)
            again = await judge_run(run, judge)
        async with open_judge(JudgeChoice()) as offline:
            await judge_run(run, offline)
        # Everything is asked once, and paid for once.
        assert len(model.asked) == asked
        assert state.cost.calls == asked + state.cost.cached
        assert state.cost.dollars == pytest.approx(asked * (12 * 2 + 3 * 8) / 1e6)
        assert (again.earlier, again.done, again.spent.calls) == (state.done, state.done, 0)
        assert again.cost.calls == state.cost.calls
        assert {purpose for purpose, _ in ledger.rows} >= {"keypoint", "fact", "response"}
        assert sum(usage.dollars for usage in ledger.rows.values()) == pytest.approx(state.cost.dollars)

    after = (run / "trajectories/00000.jsonl").read_bytes(), (run / "summary.json").read_bytes()
    assert after == before
    # The offline judge says again what it said; the model agrees but where only the server knows.
    assert compare_judges(run, RECORDED, OfflineJudge.name).differences == ()
    name, rubric = verdicts_of(run, "rubric")
    assert name == judge.name
    both = compare_judges(run, OfflineJudge.name, name)
    assert both.both == state.done
    assert both.agreed >= both.both - 2
    for difference in both.differences:
        assert difference.one.outcome is Outcome.FAILURE, difference.why()
    assert {each.outcome for each in rubric.values()} >= {Outcome.SUCCESS, Outcome.FAILURE}
    passed = [each.verdict for each in rubric.values() if each.verdict and each.verdict.reward == 1]
    assert all(
        fact.judgement.steps
        for verdict in passed
        for fact in verdict.facts
        if "stands" in fact.judgement.reason
    )
