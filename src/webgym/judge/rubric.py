"""The rubric judge: a model is asked which facts the screenshots confirm (paper §3.4).

keypoints     which screenshots matter; the last one always does
criterion B   whether every claim in the answer is visible (asked once)
criterion A   whether a fact is confirmed (asked once per fact, without showing the answer)
reference     whether the answer agrees with the reference answer, if there is one; it overrides the others
blocking      whether the website blocked an unsuccessful attempt

The reward is 1 only if all criteria hold, and 0 as soon as one does not. A question without a clear verdict
leaves the episode unjudged if the reward depends on it; else it is recorded as unread, and the reward stands.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias

from webgym.core.errors import JudgeError
from webgym.core.task import FactGroup, Task, reference_of
from webgym.core.trajectory import Episode
from webgym.core.verdict import FactJudgement, Judgement, Verdict, all_hold
from webgym.judge import prompts
from webgym.judge.base import Pictures, score_of
from webgym.judge.blocking import NOT_BLOCKED, find_block
from webgym.judge.config import JudgeConfig, Stage
from webgym.judge.keypoints import fit_in_request, page_texts, select, split_into_requests
from webgym.judge.model_client import REASON_CHARS, JudgeModelClient, Question, gather, result_or_error
from webgym.judge.prompts import action_history
from webgym.judge.reference import Match, compare
from webgym.judge.untrusted import in_parts, shorten
from webgym.judge.verdicts import Finding
from webgym.llm.completion import Completes
from webgym.llm.prices import Prices

VERSION = "rubric/4"
"""Version of the rules and prompts; raised when a change of theirs can change a verdict."""

_STEPS = re.compile(
    r"\bsteps? [0-9]{1,4}((?:(?:, ?| and |, and | & )[0-9]{1,4})+|( ?(?:-|–|to|through) ?[0-9]{1,4}))?\b",
    re.IGNORECASE,
)
Write: TypeAlias = Callable[..., tuple[str, str]]
Quoted: TypeAlias = tuple[str, ...]

ACTION_CHARS = 300
"""Longest line of the action history (one action)."""


class RubricJudge:
    """Judges any task that has a rubric.

    Args:
        config: models, limits and rules.
        models: the open model client of each stage.
        prices: dollars per token, for the cost in the verdicts.
    """

    def __init__(
        self, config: JudgeConfig, models: Mapping[Stage, Completes], prices: Prices | None = None
    ) -> None:
        self._config = config
        self._models = models
        self._prices = prices or Prices()
        self._name = f"{VERSION} {config.chat_of('fact').model}@{config.digest()}"

    @property
    def name(self) -> str:
        """Version, the fact stage's model, and a digest of every setting that can change a verdict."""
        return self._name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`."""
        client = JudgeModelClient(self._models, self._config, pictures, self._prices)
        return await _EpisodeJudging(self._name, task, episode, client, self._config).verdict()


class _EpisodeJudging:
    """The judgement of one episode, while it is being made."""

    def __init__(
        self, judge: str, task: Task, episode: Episode, client: JudgeModelClient, config: JudgeConfig
    ) -> None:
        self._judge = judge
        self._task = task
        self._episode = episode
        self._client = client
        self._config = config
        self._instruction = shorten(task.instruction, self._config.texts.instruction_chars)
        self._answer = episode.answer or ""
        self._keypoints: tuple[int, ...] | None = None
        self._facts: list[FactJudgement] = []
        self._response: Judgement | None = None
        self._reference: Judgement | None = None
        self._unread: list[JudgeError] = []

    async def verdict(self) -> Verdict:
        """Judge the episode.

        Raises:
            JudgeError: a question that the reward depends on had no clear verdict.
        """
        await self._judge_criteria()
        passed = self._is_success()
        if passed is None:
            raise self._unread[0]
        blocked = NOT_BLOCKED if passed else await self._find_block()
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
            prompts=prompts.DIGEST,
        )

    async def _judge_criteria(self) -> None:
        """Judge the criteria, the cheap ones first, so that an early exit saves the most."""
        config, task, is_answered = self._config, self._task, self._episode.answer is not None
        expected = reference_of(task.reference_answer)
        if is_answered and expected is not None:
            self._reference = await self._compare_with_reference(expected)
            decides = config.reference_rule == "decides"
            is_hopeless = decides and self._reference.passed is None
            if is_hopeless or (config.early_exit and (decides or self._reference.passed is False)):
                return
        if not is_answered and config.early_exit:
            return  # its reward is 0 either way, but its score is not
        self._keypoints = await select(task, self._episode, self._client, config)
        if config.early_exit:
            await self._judge_until_one_fails()
            return
        facts = task.rubric.facts()
        questions = [self._ask_fact(group, text) for group, _, text in facts]
        if is_answered:
            self._response, *judgements = await gather([self._ask_response(), *questions])
        else:
            judgements = await gather(questions)
        for (group, index, text), judgement in zip(facts, judgements, strict=True):
            self._facts.append(FactJudgement(group.id, index, text, judgement))

    async def _judge_until_one_fails(self) -> None:
        self._response = await self._ask_response()
        if self._response.passed is False:
            return
        for group, index, text in self._task.rubric.facts():
            judgement = await self._ask_fact(group, text)
            self._facts.append(FactJudgement(group.id, index, text, judgement))
            if judgement.passed is False:
                return

    def _is_success(self) -> bool | None:
        """Whether the reward is 1; ``None`` if it depends on a question without a clear verdict."""
        if self._episode.answer is None:
            return False
        if self._reference is not None and self._config.reference_rule == "decides":
            return self._reference.passed
        criteria = [self._reference, self._response, *(fact.judgement for fact in self._facts)]
        return all_hold(judgement for judgement in criteria if judgement is not None)

    async def _ask_fact(self, group: FactGroup, text: str) -> Judgement:
        """Criterion A: whether the screenshots confirm this fact."""
        texts = self._config.texts
        history = action_history(self._episode, line_chars=ACTION_CHARS, limit=texts.history_chars)
        write = partial(prompts.fact, instruction=self._instruction, group=group, text=text, history=history)
        return await self._ask("fact", write, (self._instruction, group.description, *group.facts, history))

    async def _ask_response(self) -> Judgement:
        """Criterion B: whether the screenshots support every claim of the answer."""
        if not self._answer.strip():
            return Judgement(False, "the answer is empty")
        parts = in_parts(self._answer, self._config.texts.answer_chars)
        questions = []
        for number, answer in enumerate(parts, 1):
            excerpt = f"{number} of {len(parts)}" if len(parts) > 1 else ""
            write = partial(prompts.response, instruction=self._instruction, answer=answer, excerpt=excerpt)
            questions.append(self._ask("response", write, (self._instruction, answer)))
        found = await gather(questions)
        for passed in (False, None):  # one that fails decides, whatever was not read
            if decisive := next((judgement for judgement in found if judgement.passed is passed), None):
                return decisive
        if len(found) == 1:
            return found[0]
        reasons = shorten("\n".join(judgement.reason for judgement in found), REASON_CHARS)
        return Judgement(True, reasons, tuple(sorted({step for each in found for step in each.steps})))

    async def _ask(self, stage: Stage, write: Write, quoted: Quoted) -> Judgement:
        """Judge a criterion by the selected screenshots, in one request or in several."""
        chosen = self._keypoints or ()
        split = split_into_requests(self._episode, chosen, stage, self._config, write)
        ask = self._ask_in_parts if len(split) > 1 else self._ask_once
        return self._read(await result_or_error(ask(stage, write, quoted, split)), chosen)

    async def _ask_once(
        self, stage: Stage, write: Write, quoted: Quoted, split: Sequence[Sequence[int]]
    ) -> Finding:
        (part,) = split
        text, shots, _ = fit_in_request(self._episode, part, stage, self._config, write)
        untrusted = (*quoted, *page_texts(self._episode.observations, part))
        return await self._client.ask(Question(stage, "criterion", text, shots, untrusted))

    async def _ask_in_parts(
        self, stage: Stage, write: Write, quoted: Quoted, split: Sequence[Sequence[int]]
    ) -> Finding:
        """Judge a criterion by screenshots that do not fit in one request.

        A fact that every part confirms is confirmed. Everything else is decided by a last request about the
        notes on all parts: what one part shows may be contradicted or undone in another, or a total be spread
        over all.
        """
        count = len(split)
        results = await gather(
            result_or_error(
                self._ask_once(stage, partial(write, part=f"{number} of {count}"), quoted, [part])
            )
            for number, part in enumerate(split, 1)
        )
        if unread := next((result for result in results if isinstance(result, JudgeError)), None):
            raise unread
        notes = [result for result in results if isinstance(result, Finding)]
        if stage == "fact" and all(note.passed for note in notes):
            return notes[-1]
        limit = self._config.texts.history_chars // count
        parts = [
            f"Part {number} of {count}:\n{shorten(note.reason, limit)}"
            for number, note in enumerate(notes, 1)
        ]
        closing = partial(write, labels=(), notes="\n\n".join(parts))
        return await self._client.ask(Question(stage, "criterion", closing, (), (*quoted, *parts)))

    def _read(self, result: Finding | JudgeError, chosen: Sequence[int]) -> Judgement:
        """The judgement that is recorded for a finding or for a missing verdict, which is noted in
        ``_unread``."""
        if isinstance(result, Finding):
            return self._judgement(result, chosen)
        self._unread.append(result)
        return Judgement(None, f"not read: {shorten(result.message, REASON_CHARS)}")

    async def _compare_with_reference(self, expected: str) -> Judgement:
        """Compare the answer with the reference answer: by the rule where it is sure, else by a model."""
        found, limit = compare(expected, self._answer), self._config.texts.answer_chars
        if found.match is not Match.UNSURE:
            return Judgement(found.match is Match.SAME, found.reason)
        if len(expected) > limit:
            why = f"the reference answer is longer than {limit} characters"
            return self._read(JudgeError(why, hint="raise texts.answer_chars"), ())
        if len(self._answer) > limit:
            return Judgement(
                False, f"the answer is longer than {limit} characters, as no reference answer is"
            )
        write = partial(
            prompts.reference, instruction=self._instruction, answer=self._answer, expected=expected
        )
        quoted = (self._instruction, self._answer, expected)
        return self._read(
            await result_or_error(self._client.ask(Question("reference", "question", write, (), quoted))), ()
        )

    async def _find_block(self) -> Judgement:
        """Whether the website blocked the agent: by rules, and by a model where possible refusals are not
        recognised."""
        by_rule = find_block(self._task, self._episode)
        if by_rule.passed or not self._config.blocking_model:
            return by_rule
        with_suspects = find_block(self._task, self._episode, suspect_last=True)
        if not with_suspects.passed:
            return by_rule  # whatever a model would say, the attempt was not blocked
        seen, texts = self._episode.observations, self._config.texts
        last = with_suspects.steps[-self._config.blocking.images_per_call :]
        pages = "\n".join(f"{seen[i].url}, status {seen[i].status}, {seen[i].title}" for i in last)
        history = action_history(self._episode, line_chars=ACTION_CHARS, limit=texts.history_chars)
        write = partial(prompts.blocking, website=self._task.website, history=history, last=pages)
        text, shots, chosen = fit_in_request(self._episode, last, "blocking", self._config, write)
        untrusted = (self._task.website, history, pages, *page_texts(seen, chosen))
        finding = await self._client.ask(Question("blocking", "question", text, shots, untrusted))
        return self._judgement(finding, chosen)

    def _judgement(self, finding: Finding, chosen: Sequence[int]) -> Judgement:
        """The judgement that is recorded for a finding: its reason, and the steps shown that the reason
        names."""
        reason = shorten(finding.reason, REASON_CHARS).strip()
        return Judgement(finding.passed, reason or "no reason was given", cited(reason, chosen))


def cited(reason: str, among: Sequence[int]) -> tuple[int, ...]:
    """Indices, among those given, of the steps that a reason names ("step 4", "steps 2, 3 and 5")."""
    named: set[int] = set()
    for match in _STEPS.finditer(reason):
        numbers = [int(number) for number in re.findall(r"[0-9]+", match[0])]
        is_range = match[2] is not None
        named.update(range(numbers[0], numbers[-1] + 1) if is_range and len(numbers) == 2 else numbers)
    return tuple(index for index in among if index + 1 in named)
