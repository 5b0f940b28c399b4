"""Asking a judge model a question, again if needed, until the reply contains a clear verdict."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final, TypeAlias, TypeVar

import msgspec

from webgym.core.background import task_group
from webgym.core.errors import JudgeError, LLMError
from webgym.core.verdict import Cost
from webgym.judge.base import Pictures
from webgym.judge.config import JudgeConfig, Stage
from webgym.judge.images import data_url
from webgym.judge.untrusted import code_of
from webgym.judge.verdicts import (
    Finding,
    NoVerdict,
    Words,
    lines_of,
    may_be_echoed,
    read_per_image,
    read_verdict,
)
from webgym.llm.completion import Completes, Completion
from webgym.llm.prices import Prices

T = TypeVar("T")

_MAX_UNUSABLE: Final = 4
"""Most unusable replies in one conversation, as a multiple of ``tries``: the request grows with each."""

REASON_CHARS = 1_200
"""Longest reason that is kept in the verdict."""


class LabelledScreenshot(msgspec.Struct, frozen=True):
    """A screenshot in a question.

    Attributes:
        label: what the question calls it.
        name: of the image: the hash of its pixels.
    """

    label: str
    name: str


Write: TypeAlias = Callable[[str], tuple[str, str]]
"""Maps the request's signature code to the texts of the system message and the user message."""


class Question(msgspec.Struct, frozen=True):
    """One request to a judge model.

    Attributes:
        stage: decides which model is asked.
        words: the words that state a verdict in the reply.
        write: makes the texts from the request's signature code.
        shots: the screenshots, in order.
        untrusted: all text in the request that comes from the agent or a website; a verdict that merely
            repeats it does not count. ``None`` for a text that was not recorded.
    """

    stage: Stage
    words: Words
    write: Write
    shots: tuple[LabelledScreenshot, ...]
    untrusted: tuple[str | None, ...]


class JudgeModelClient:
    """Asks the judge's models questions about one episode and adds up the cost.

    Args:
        models: the model of each stage.
        config: the judge's settings.
        pictures: returns a screenshot of the episode by its name.
        prices: dollars per token, for the models whose price is known.

    Attributes:
        cost: of all calls so far.
    """

    def __init__(
        self, models: Mapping[Stage, Completes], config: JudgeConfig, pictures: Pictures, prices: Prices
    ) -> None:
        self._models = models
        self._config = config
        self._pictures = pictures
        self._prices = prices
        self._slots = asyncio.Semaphore(config.concurrency)
        self._urls: dict[str, str] = {}
        self.cost = Cost()

    async def ask(self, question: Question) -> Finding:
        """The model's finding.

        Raises:
            JudgeError: the model cannot be asked, or none of its replies had a clear verdict.
        """
        return await self.ask_until_clear(question, partial(read_verdict, words=question.words))

    async def ask_per_image(self, question: Question) -> tuple[bool, ...]:
        """One finding for each of the question's screenshots.

        Raises:
            JudgeError: as for :meth:`ask`.
        """
        return await self.ask_until_clear(question, partial(read_per_image, count=len(question.shots)))

    def _signature(self, question: Question) -> tuple[str, bool]:
        """The request's code, and whether a verdict without it counts."""
        content = [question.stage, *question.write("")]
        texts = (text or "" for text in question.untrusted)
        code = code_of(*content, *(shot.name for shot in question.shots), *texts)
        bare = not self._config.signed_verdicts and not may_be_echoed(question.untrusted, question.words)
        return code, bare

    async def ask_until_clear(self, question: Question, read: Callable[..., T | NoVerdict]) -> T:
        """What ``read`` finds in the model's reply, whose problem it is told until there is none.

        Args:
            question: the request.
            read: takes the reply's lines, ``code`` and ``bare``, as
                :func:`webgym.judge.verdicts.read_verdict` does.

        Raises:
            JudgeError: as for :meth:`ask`.
        """
        code, bare = self._signature(question)
        system, text = question.write(code)
        async with self._slots:
            content = [{"type": "text", "text": text}, *await self._images(question.shots)]
            messages: list[dict[str, Any]] = [
                {"role": "system", "content": system},
                {"role": "user", "content": content if question.shots else text},
            ]
            problem, unusable, tries, refused = "", 0, 0, 0
            # An unusable reply that comes from the cache does not count as a try: otherwise an attempt that
            # once got no verdict could never get one.
            while tries < self._config.tries and unusable < _MAX_UNUSABLE * self._config.tries:
                reply = await self._reply(question.stage, messages, is_repeat=unusable > 0)
                lines = lines_of(reply.text, reply.finish_reason, reply.refusal)
                verdict = lines if isinstance(lines, NoVerdict) else read(lines, code=code, bare=bare)
                if not isinstance(verdict, NoVerdict):
                    return verdict
                problem, unusable, tries = verdict.why, unusable + 1, tries + (not reply.cached)
                refused += verdict.is_refused and not reply.cached
                if refused > 1:
                    break
                messages = [
                    *messages,
                    *_correction_request(reply.text, problem, REASON_CHARS),
                ]
        raise JudgeError(
            f"no clear verdict in {unusable} replies at the {question.stage} stage: {problem}",
            hint="another judge model, or another filter at its endpoint, may answer"
            if refused
            else "look at the judge model's replies; a larger model or more max_tokens may help",
        )

    async def _reply(self, stage: Stage, messages: list[dict[str, Any]], *, is_repeat: bool) -> Completion:
        try:
            reply = await self._models[stage].complete(messages, self._config.stage(stage).sampling)
        except LLMError as error:
            raise JudgeError(f"the {stage} stage: {error.message}", hint=error.hint) from error
        self.cost += self._cost(stage, reply, is_repeat)
        return reply

    def _cost(self, stage: Stage, reply: Completion, is_repeat: bool) -> Cost:
        if reply.cached:
            return Cost(calls=1, cached=1, repeats=int(is_repeat))
        price = self._prices.of(self._config.chat_of(stage).model)
        tokens = reply.prompt_tokens, reply.completion_tokens
        dollars = price.dollars(*tokens, cached_tokens=reply.prompt_tokens_cached) if price else 0.0
        return Cost(1, 0, int(is_repeat), *tokens, dollars)

    async def _images(self, shots: Sequence[LabelledScreenshot]) -> list[dict[str, Any]]:
        content: list[dict[str, Any]] = []
        for shot in shots:
            if (url := self._urls.get(shot.name)) is None:
                data = await self._pictures(shot.name)
                url = await asyncio.to_thread(data_url, shot.name, data, self._config.images)
                self._urls[shot.name] = url
            content.append({"type": "text", "text": f"{shot.label}:"})
            content.append({"type": "image_url", "image_url": {"url": url}})
        return content


async def gather(questions: Iterable[Coroutine[Any, Any, T]]) -> list[T]:
    """Ask all questions concurrently; results in their order. The first error cancels the rest.

    Raises:
        JudgeError: the first error, not wrapped in an exception group.
    """
    async with task_group() as group:
        tasks = [group.create_task(question) for question in questions]
    return [task.result() for task in tasks]


async def result_or_error(question: Coroutine[Any, Any, T]) -> T | JudgeError:
    """A question's result, or its error as a value: for questions whose result may turn out not to matter."""
    try:
        return await question
    except JudgeError as error:
        return error


def _correction_request(reply: str, why: str, limit: int) -> list[dict[str, Any]]:
    """Two messages: the end of the unusable reply, and a request to correct what was wrong with it."""
    excerpt = reply[-limit:] or "(an empty reply)"
    return [
        {"role": "assistant", "content": excerpt},
        {
            "role": "user",
            "content": f"That reply cannot be used: {why}. Answer the question again, briefly, and end with "
            "the verdict exactly as it was asked for.",
        },
    ]
