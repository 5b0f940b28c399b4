"""The rubric judge: a model looks at screenshots and says which facts they confirm (paper §3.4).

keypoints     which screenshots matter; the last one always does
criterion B   every claim in the answer is visible (once)
criterion A   this fact is confirmed (once per fact, without the answer)
reference     the answer agrees with the reference answer, where there is one: it overrides
blocking      an attempt that did not succeed: was it kept out?

The reward is 1 only if all of them hold, and 0 as soon as one does not. A question without a clear verdict
leaves the episode unjudged if the reward hangs on it; else it is noted as unread, and the reward stands.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias

from webgym.core.errors import JudgeError
from webgym.core.task import FactGroup, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import FactJudgement, Judgement, Verdict, all_hold
from webgym.judge import prompts
from webgym.judge.base import Pictures
from webgym.judge.blocking import find_block
from webgym.judge.config import STAGES, JudgeConfig, Stage
from webgym.judge.history import action_history
from webgym.judge.keypoints import page_texts, parts, select, shown
from webgym.judge.model_client import JudgeModelClient, Question, gather, result_or_error
from webgym.judge.reference import hold_against, is_reference
from webgym.judge.soft import score_of
from webgym.judge.untrusted import code_of, shorten
from webgym.judge.value_comparison import Match
from webgym.judge.verdicts import Finding
from webgym.llm.completion import Completes
from webgym.llm.prices import Prices

VERSION = "rubric/2"
"""Of the rules and prompts; raised when a change of theirs can change a verdict."""

_STEPS = re.compile(
    r"\bsteps? [0-9]{1,4}((?:(?:, ?| and |, and | & )[0-9]{1,4})+|( ?(?:-|–|to|through) ?[0-9]{1,4}))?\b",
    re.IGNORECASE,
)
Write: TypeAlias = Callable[..., tuple[str, str]]
Quoted: TypeAlias = tuple[str, ...]
_NOT_LOOKED = Judgement(False, "the attempt succeeded")


class RubricJudge:
    """Judges any task that has a rubric.

    Args:
        config: stages, limits, rules.
        models: who is asked at each stage, open.
        prices: what tokens cost, for the verdicts' cost.
    """

    def __init__(
        self, config: JudgeConfig, models: Mapping[Stage, Completes], prices: Prices | None = None
    ) -> None:
        self._config = config
        self._models = models
        self._prices = prices or Prices()
        self._name = f"{VERSION} {config.chat_of('fact').model}@{_digest(config)}"

    @property
    def name(self) -> str:
        """Version, the fact stage's model, and a digest of every setting that can change a verdict."""
        return self._name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`."""
        client = JudgeModelClient(self._models, self._config, pictures, self._prices)
        return await _Case(self._name, task, episode, client, self._config).verdict()


def _digest(config: JudgeConfig) -> str:
    """Of every setting that can change a verdict; not of where a model is served, or how patiently."""
    stages = {
        name: config.stage(name).model_dump(mode="json", exclude={"chat"})
        | {"model": config.chat_of(name).model}
        for name in STAGES
    }
    rules = config.model_dump(mode="json", exclude={"chat", "concurrency", "tries", *STAGES})
    return code_of(json.dumps([stages, rules], sort_keys=True))[:6]


class _Case:
    """One episode being judged."""

    def __init__(
        self, judge: str, task: Task, episode: Episode, client: JudgeModelClient, config: JudgeConfig
    ) -> None:
        self._judge = judge
        self._task = task
        self._episode = episode
        self._client = client
        self._config = config
        self._instruction = shorten(task.instruction, config.texts.instruction_chars)
        self._answer = shorten(episode.answer or "", config.texts.answer_chars)
        self._keypoints: tuple[int, ...] | None = None
        self._facts: list[FactJudgement] = []
        self._response: Judgement | None = None
        self._reference: Judgement | None = None
        self._unread: list[JudgeError] = []

    async def verdict(self) -> Verdict:
        """The whole judgement.

        Raises:
            JudgeError: a question that the reward hangs on had no clear verdict.
        """
        await self._look()
        passed = self._is_met()
        if passed is None:
            raise self._unread[0]
        blocked = _NOT_LOOKED if passed else await self._find_block()
        return Verdict(
            judge=self._judge,
            reward=None if blocked.passed else int(passed),
            facts=tuple(self._facts),
            response=self._response,
            reference=self._reference,
            blocked=blocked,
            score=score_of(self._task.rubric, self._facts),
            keypoints=self._keypoints,
            cost=self._client.cost,
        )

    async def _look(self) -> None:
        """Judge the criteria; what costs little comes first, so that an early exit saves the most."""
        config, task, is_answered = self._config, self._task, self._episode.answer is not None
        if is_answered and task.reference_answer is not None and is_reference(task.reference_answer):
            self._reference = await self._hold_against(task.reference_answer)
            alone = config.reference_rule == "decides"
            is_hopeless = alone and self._reference.passed is None
            if is_hopeless or (config.early_exit and (alone or self._reference.passed is False)):
                return
        if not is_answered and (config.early_exit or not config.judge_unanswered):
            return
        self._keypoints = await select(task, self._episode, self._client, config)
        if config.early_exit:
            await self._look_until_one_fails()
            return
        facts = task.rubric.facts()
        questions = [self._ask_fact(group, text) for group, _, text in facts]
        if is_answered:
            self._response, *found = await gather([self._ask_response(), *questions])
        else:
            found = await gather(questions)
        for (group, index, text), judgement in zip(facts, found, strict=True):
            self._facts.append(FactJudgement(group.id, index, text, judgement))

    async def _look_until_one_fails(self) -> None:
        self._response = await self._ask_response()
        if self._response.passed is False:
            return
        for group, index, text in self._task.rubric.facts():
            judgement = await self._ask_fact(group, text)
            self._facts.append(FactJudgement(group.id, index, text, judgement))
            if judgement.passed is False:
                return

    def _is_met(self) -> bool | None:
        """Whether the reward is 1; ``None`` if it hangs on a question without a clear verdict."""
        if self._episode.answer is None:
            return False
        if self._reference is not None and self._config.reference_rule == "decides":
            return self._reference.passed
        criteria = [self._reference, self._response, *(fact.judgement for fact in self._facts)]
        return all_hold(judgement for judgement in criteria if judgement is not None)

    async def _ask_fact(self, group: FactGroup, text: str) -> Judgement:
        """Criterion A."""
        texts = self._config.texts
        history = action_history(self._episode, line_chars=texts.action_chars, limit=texts.history_chars)
        write = partial(prompts.fact, instruction=self._instruction, group=group, text=text, history=history)
        return await self._ask("fact", write, (self._instruction, group.description, *group.facts, history))

    async def _ask_response(self) -> Judgement:
        """Criterion B."""
        if not self._answer.strip():
            return Judgement(False, "the answer is empty")
        write = partial(prompts.response, instruction=self._instruction, answer=self._answer)
        return await self._ask("response", write, (self._instruction, self._answer))

    async def _ask(self, stage: Stage, write: Write, quoted: Quoted) -> Judgement:
        """A criterion by the chosen screenshots: in one request, or else part by part."""
        chosen = self._keypoints or ()
        split = parts(self._episode, chosen, stage, self._config, write)
        one = self._by_parts if len(split) > 1 else self._by_part
        return self._read(await result_or_error(one(stage, write, quoted, split)), chosen)

    async def _by_part(
        self, stage: Stage, write: Write, quoted: Quoted, split: Sequence[Sequence[int]]
    ) -> Finding:
        (part,) = split
        text, shots, _ = shown(self._episode, part, stage, self._config, write)
        untrusted = (*quoted, *page_texts(self._episode.observations, part))
        return await self._client.ask(Question(stage, "criterion", text, shots, untrusted))

    async def _by_parts(
        self, stage: Stage, write: Write, quoted: Quoted, split: Sequence[Sequence[int]]
    ) -> Finding:
        """A fact that a part confirms is confirmed. All else is decided over what the parts are said to show:
        a claim may be visible in one of them and contradicted in another, a total be spread over all.
        """
        count = len(split)
        found = await gather(
            result_or_error(self._by_part(stage, partial(write, part=f"{number} of {count}"), quoted, [part]))
            for number, part in enumerate(split, 1)
        )
        notes = [each for each in found if isinstance(each, Finding)]
        if stage == "fact" and (confirmed := next((note for note in notes if note.passed), None)):
            return confirmed
        if unread := next((each for each in found if isinstance(each, JudgeError)), None):
            raise unread
        limit = self._config.texts.history_chars // count
        told = [
            f"Part {number} of {count}:\n{shorten(note.reason, limit)}"
            for number, note in enumerate(notes, 1)
        ]
        closing = partial(write, labels=(), notes="\n\n".join(told))
        return await self._client.ask(Question(stage, "criterion", closing, (), (*quoted, *told)))

    def _read(self, found: Finding | JudgeError, chosen: Sequence[int]) -> Judgement:
        """A finding as it is recorded, or that there is none."""
        if isinstance(found, Finding):
            return self._judgement(found, chosen)
        self._unread.append(found)
        return Judgement(None, f"not read: {shorten(found.message, self._config.texts.reason_chars)}")

    async def _hold_against(self, expected: str) -> Judgement:
        """The reference answer: by rule where rules are sure, else by a model."""
        config = self._config
        ways = config.ways_by_source.get(self._task.source, config.reference_ways)
        found = hold_against(expected, self._episode.answer or "", ways, self._task.instruction)
        if found.match is not Match.UNSURE:
            return Judgement(found.match is Match.SAME, found.reason)
        if "model" not in ways:
            return Judgement(False, f"{found.reason}, and no model is asked for this source")
        expected = shorten(expected, config.texts.answer_chars)
        write = partial(
            prompts.reference, instruction=self._instruction, answer=self._answer, expected=expected
        )
        quoted = (self._instruction, self._answer, expected)
        return self._read(
            await result_or_error(self._client.ask(Question("reference", "question", write, (), quoted))), ()
        )

    async def _find_block(self) -> Judgement:
        """What the rules see; where they see nothing, what a model sees in what could be refusals."""
        by_rule = find_block(self._task, self._episode)
        if by_rule.passed or not self._config.blocking_model:
            return by_rule
        at_most = find_block(self._task, self._episode, suspect_last=True)
        if not at_most.passed:
            return by_rule  # whatever a model said, the attempt would not be blocked
        seen, texts = self._episode.observations, self._config.texts
        last = at_most.steps[-self._config.blocking.images_per_call :]
        pages = "\n".join(f"{seen[i].url}, status {seen[i].status}, {seen[i].title}" for i in last)
        history = action_history(self._episode, line_chars=texts.action_chars, limit=texts.history_chars)
        write = partial(prompts.blocking, website=self._task.website, history=history, last=pages)
        text, shots, chosen = shown(self._episode, last, "blocking", self._config, write)
        untrusted = (self._task.website, history, pages, *page_texts(seen, chosen))
        finding = await self._client.ask(Question("blocking", "question", text, shots, untrusted))
        return self._judgement(finding, chosen)

    def _judgement(self, finding: Finding, chosen: Sequence[int]) -> Judgement:
        """A finding as it is recorded: its reason, and the steps that it names of those it was shown."""
        reason = shorten(finding.reason, self._config.texts.reason_chars).strip()
        return Judgement(finding.passed, reason or "no reason was given", cited(reason, chosen))


def cited(reason: str, among: Sequence[int]) -> tuple[int, ...]:
    """Indices of the observations that a reason names as steps ("step 4", "steps 2, 3 and 5")."""
    named: set[int] = set()
    for match in _STEPS.finditer(reason):
        numbers = [int(number) for number in re.findall(r"[0-9]+", match[0])]
        is_range = match[2] is not None
        named.update(range(numbers[0], numbers[-1] + 1) if is_range and len(numbers) == 2 else numbers)
    return tuple(index for index in among if index + 1 in named)
