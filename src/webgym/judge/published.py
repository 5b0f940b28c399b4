"""The judges of published benchmarks, by their published rules and in our own words.

WebJudge (Online-Mind2Web, arXiv 2504.01382): the model lists the task's key points, scores every screenshot
from 1 to 5, and decides by the actions and the screenshots that score at least 3, the first 50 of them. The
agent's answer is not shown. WebVoyager's judge (arXiv 2401.13919) decides by the answer and the last 15
screenshots; DeepShop's (arXiv 2506.02839) asks the same of each requirement of the task, and all must hold.

The replies have the forms that the benchmarks published, so models that were trained for them can serve. A
reply without a clear verdict or score is asked for again, and in the end leaves the attempt unjudged. As with
every judge here, an attempt without an answer is no success, and rules alone say whether a website blocked.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar, Final, NamedTuple

from msgspec.structs import replace

from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import FactJudgement, Judgement, Verdict
from webgym.judge.base import Pictures, score_of
from webgym.judge.blocking import NOT_BLOCKED, find_block
from webgym.judge.config import JudgeConfig, Stage
from webgym.judge.keypoints import label, page_texts
from webgym.judge.model_client import REASON_CHARS, JudgeModelClient, LabelledScreenshot, Question, gather
from webgym.judge.prompts import action_history, digest, framed
from webgym.judge.rubric import cited
from webgym.judge.untrusted import quote, shorten
from webgym.judge.verdicts import Finding, NoVerdict, plain
from webgym.judge.webjudge import SUCCESS, read_status
from webgym.llm.completion import Completes
from webgym.llm.prices import Prices

SCORE_AT_LEAST: Final = 3
"""Score from which WebJudge shows a screenshot to the model that decides."""
MOST_SHOWN: Final = 50
"""Most screenshots that it shows."""
LAST_SHOWN: Final = 15
"""Number of last screenshots that WebVoyager's and DeepShop's judges show."""
_ACTION_CHARS: Final = 300
_NOTE_CHARS: Final = 600
"""Longest note on a screenshot, characters."""

_POINTS: Final = """\
Your task now: list what the task itself demands, as the points that an inspector will tick off.
- One point for each condition, value, filter, order, item or action that the task names, in its own words \
where they serve. Nothing that it leaves open.
- A superlative (cheapest, newest, best rated, closest, largest) asks for the website's own sorting or \
filtering: write it as such a point.

Reply with the line **Key Points**: and below it the numbered points, one a line, with no remarks."""

_SCORE: Final = """\
Your task now: say how much one screenshot tells an inspector who has to decide whether the task was done.
Describe first what it shows that bears on the key points: filters and orders in force, values, chosen \
items, forms, confirmations, how far the work had come. A part of the evidence is worth something too.
Then score:
1: nothing that bears on the task; 2: next to nothing, or unclear; 3: some of it, but not clearly or not \
whole; 4: important evidence, though not all; 5: clear evidence that the outcome hangs on.

Reply in two parts, and write nothing after the digit:
**Reasoning**: what you see, and why it matters or not
**Score**: one digit from 1 to 5"""

_OUTCOME: Final = """\
Your task now: decide whether the agent did the whole task. You get the key points of the task, the list of \
what the agent did, and the screenshots that may matter, with a note on each. Check point by point:
- A filter, an order or a choice counts once a page shows that it is in force; not if it was forgotten, \
never confirmed, or without visible effect.
- A superlative needs the website's sorting or filtering where its key point says so.
- Conditions that belong into filters belong there: words typed into a search box do not make sure of them.
- A range, a number or a date in a filter must be the task's exactly, neither wider nor narrower: up to $40 \
is not up to $30, and "3 or more" is not 3.
- Where the task ends in sending something or in showing results, that must be seen.
- Right steps that lead to an empty result are right.
- No filter is needed where a page shows all there is and the agent took the right one.

Reply in two lines:
Thoughts: how each key point fares
Status: "success" or "failure\""""

_SUCCESS: Final = """\
Your task now: decide whether a task was accomplished. You get the task, the agent's answer, and the last \
screenshots, which are genuine.
- Go by what the screenshots and the answer show; suppose nothing else, and do nothing on the website.
- A task with several parts is accomplished if all of them are.
- The answer was written afterwards. Where it contradicts a screenshot, the screenshot is right. Where it \
says what no screenshot shows, believe it.

Say how you come to your verdict. Then end with one line that is SUCCESS or NOT SUCCESS and nothing else."""

_DIGIT: Final = re.compile(
    r"\bscore\b[^a-z0-9]{0,20}(?P<digit>[1-5])(?![0-9]|[.,][0-9]|\s?[-–—]\s?[0-9])", re.IGNORECASE
)
_POINTS_LABEL: Final = re.compile(r"key points\W*:\W*", re.IGNORECASE)
_REASONING_LABEL: Final = re.compile(r"\W*(?:[0-9]\W+)?reasoning\W*", re.IGNORECASE)


class _Score(NamedTuple):
    """What the model says of a screenshot: a score from 1 to 5, and why."""

    digit: int
    note: str


def read_points(lines: Sequence[str], **_: object) -> str | NoVerdict:
    """The key points that a reply lists."""
    whole = "\n".join(lines)
    match = _POINTS_LABEL.search(whole)
    points = whole[match.end() :] if match else whole
    return points.strip() or NoVerdict("it lists no key point")


def read_score(lines: Sequence[str], **_: object) -> _Score | NoVerdict:
    """The score that a reply ends in, with the reasoning before it."""
    whole = "\n".join(lines)
    found = list(_DIGIT.finditer(whole))
    if not found:
        return NoVerdict("it must end with a line such as **Score**: 3, from 1 to 5")
    note = _REASONING_LABEL.sub("", whole[: found[-1].start()], count=1).rstrip(" *#\n0123456789.")
    return _Score(int(found[-1]["digit"]), shorten(" ".join(note.split()), _NOTE_CHARS))


def _read_verdict(lines: Sequence[str], *, form: re.Pattern[str] | None, **_: object) -> Finding | NoVerdict:
    text = "\n".join(lines)
    passed = read_status(text) if form is None else read_status(text, form)
    if passed is None:
        words = 'Status: "success" or Status: "failure"' if form is None else "SUCCESS or NOT SUCCESS"
        return NoVerdict(f"it must end with exactly one line that says {words}")
    verdicts = ("status", "success", "not success")
    reason = "\n".join(line for line in lines if not plain(line).startswith(verdicts))
    return Finding(passed, reason)


read_outcome = partial(_read_verdict, form=None)
"""The verdict of a WebJudge reply."""
read_success = partial(_read_verdict, form=SUCCESS)
"""The verdict of a reply to WebVoyager's question."""


class _Asking:
    """The questions about one episode."""

    def __init__(self, task: Task, episode: Episode, client: JudgeModelClient, config: JudgeConfig) -> None:
        self.task = task
        self.episode = episode
        self.client = client
        self.config = config
        self.instruction = shorten(task.instruction, config.texts.instruction_chars)

    def question(
        self, stage: Stage, rules: str, quoted: Mapping[str, str], shown: Sequence[int] = ()
    ) -> Question:
        """A question with these rules, quoted texts by label, and observations by their indices."""
        seen = self.episode.observations
        shots = tuple(LabelledScreenshot(label(self.episode, i), seen[i].screenshot) for i in shown)

        def write(code: str) -> tuple[str, str]:
            texts = [f"The {name}:\n{quote(name, text, code)}" for name, text in quoted.items()]
            return framed(code, rules), "\n".join((*texts, f"{len(shots)} screenshots follow."))

        return Question(stage, "criterion", write, shots, (*quoted.values(), *page_texts(seen, shown)))


class PublishedJudge(ABC):
    """A judge whose rules a benchmark published.

    Args:
        config: models and limits.
        models: the open model client of each stage.
        prices: dollars per token, for the cost in the verdicts.
    """

    version: ClassVar[str]
    """Name and version of its rules; raised when a change of theirs can change a verdict."""
    prompts: ClassVar[str]
    """SHA-256 of its prompts."""

    def __init__(
        self, config: JudgeConfig, models: Mapping[Stage, Completes], prices: Prices | None = None
    ) -> None:
        self._config = config
        self._models = models
        self._prices = prices or Prices()

    @property
    def name(self) -> str:
        """Version, the model that decides, and a digest of the settings."""
        return f"{self.version} {self._config.chat_of('response').model}@{self._config.digest()}"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`."""
        client = JudgeModelClient(self._models, self._config, pictures, self._prices)
        verdict = Verdict(self.name, 0, (), NOT_BLOCKED, cost=client.cost, prompts=self.prompts)
        if episode.answer is not None:
            verdict = await self._decide(_Asking(task, episode, client, self._config), verdict)
        blocked = verdict.blocked if verdict.reward else find_block(task, episode)
        reward = None if blocked.passed else verdict.reward
        return replace(verdict, reward=reward, blocked=blocked, cost=client.cost)

    @abstractmethod
    async def _decide(self, asking: _Asking, verdict: Verdict) -> Verdict:
        """The verdict on an answered attempt."""


class WebJudge(PublishedJudge):
    """Key points, a score for each screenshot, and the outcome."""

    version = "webjudge/1"
    prompts = digest(_POINTS, _SCORE, _OUTCOME)

    async def _decide(self, asking: _Asking, verdict: Verdict) -> Verdict:
        client, task = asking.client, {"task": asking.instruction}
        points = await client.ask_until_clear(asking.question("keypoint", _POINTS, task), read_points)
        known = task | {"points": points}
        # Equal pictures are equal evidence: each is scored and shown once, where it was last seen.
        latest = {seen.screenshot: index for index, seen in enumerate(asking.episode.observations)}
        indices = sorted(latest.values())
        scores = await gather(
            client.ask_until_clear(asking.question("keypoint", _SCORE, known, [index]), read_score)
            for index in indices
        )
        scored = zip(indices, scores, strict=True)
        shown = [(index, score) for index, score in scored if score.digit >= SCORE_AT_LEAST][:MOST_SHOWN]
        limit = self._config.texts.history_chars
        known |= {"actions": action_history(asking.episode, line_chars=_ACTION_CHARS, limit=limit)}
        if shown:
            notes = (f"{label(asking.episode, index)}: {score.note}" for index, score in shown)
            known |= {"notes": "\n".join(notes)}
        chosen = tuple(index for index, _ in shown)
        question = asking.question("response", _OUTCOME, known, chosen)
        found = await client.ask_until_clear(question, read_outcome)
        response = _judgement(found, chosen)
        return replace(verdict, reward=int(found.passed), response=response, keypoints=chosen)


class WebVoyagerJudge(PublishedJudge):
    """One question about the task, the answer and the last screenshots."""

    version = "webvoyager/1"
    prompts = digest(_SUCCESS)

    async def _decide(self, asking: _Asking, verdict: Verdict) -> Verdict:
        last = _last(asking.episode)
        response = _judgement(await _ask_success(asking, asking.instruction, last), last)
        return replace(verdict, reward=int(response.passed or False), response=response, keypoints=last)


class DeepShopJudge(PublishedJudge):
    """WebVoyager's question about each requirement of the task, which are the facts of its rubric."""

    version = "deepshop/1"
    prompts = digest(_SUCCESS)

    async def _decide(self, asking: _Asking, verdict: Verdict) -> Verdict:
        last, rubric = _last(asking.episode), asking.task.rubric
        facts = rubric.facts()
        texts = [asking.instruction] if rubric == WHOLE_TASK else [text for _, _, text in facts]
        found = await gather(_ask_success(asking, text, last) for text in texts)
        judged = tuple(
            FactJudgement(group.id, index, text, _judgement(finding, last))
            for (group, index, text), finding in zip(facts, found, strict=True)
        )
        reward = int(all(finding.passed for finding in found))
        return replace(verdict, reward=reward, facts=judged, score=score_of(rubric, judged), keypoints=last)


async def _ask_success(asking: _Asking, text: str, shown: Sequence[int]) -> Finding:
    answer = shorten(asking.episode.answer or "", asking.config.texts.answer_chars)
    if not answer.strip():
        return Finding(False, "the answer is empty")
    question = asking.question("response", _SUCCESS, {"task": text, "answer": answer}, shown)
    return await asking.client.ask_until_clear(question, read_success)


def _last(episode: Episode) -> tuple[int, ...]:
    return tuple(range(len(episode.observations)))[-LAST_SHOWN:]


def _judgement(finding: Finding, shown: Sequence[int]) -> Judgement:
    reason = shorten(finding.reason, REASON_CHARS).strip()
    return Judgement(finding.passed, reason or "no reason was given", cited(reason, shown))
