"""Estimates the calls and the cost of a build before it starts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from webgym.core.errors import NotCached
from webgym.core.tables import Table, printed
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completion, read_completion
from webgym.llm.config import Sampling
from webgym.llm.prices import Prices
from webgym.llm.request import Formats, Request
from webgym.llm.tokens import count_messages, count_text
from webgym.taskset import prompts
from webgym.taskset.construction.config import Purpose
from webgym.taskset.construction.pipeline import Build, Tally

_FACTS_TOKENS: Final = 120
"""Approximate tokens of the facts and the kind of task in a request to rewrite or to check."""

_LATER_PROMPTS: Final[Mapping[Purpose, str]] = {
    "rewriting": prompts.REWRITING,
    "critic": prompts.RUBRIC_CRITIC,
}
"""The system messages of the purposes whose requests depend on other replies."""

ASKED_AGAIN = 0.1
"""Average number of repeated calls per request, because of unusable replies."""

DERIVED_PER_TASK = 0.1
"""Average number of tasks derived from a task whose rubric is not written yet."""

MEASURED_FROM = 30
"""Number of finished requests of a purpose from which on measured values replace assumed ones."""


class Estimator:
    """Replaces a model client in a dry run: replies from the cache, and counts the calls it would make.

    Args:
        client: the client that it replaces.
        cache: the cache of replies; ``None`` if there is none yet.

    Attributes:
        calls, prompt_tokens: number of calls that would be made now, and their prompt tokens.
        replies, reply_tokens: number of replies from the cache, and their tokens.
    """

    def __init__(self, client: ChatClient, cache: ReplyCache | None) -> None:
        self._client = client
        self._cache = cache
        self._schemas: dict[str, int] = {}
        self.calls = self.prompt_tokens = self.replies = self.reply_tokens = 0

    @property
    def sampling(self) -> Sampling:
        """The client's."""
        return self._client.sampling

    @property
    def formats(self) -> Formats:
        """The client's."""
        return self._client.formats

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """The reply from the cache.

        Raises:
            NotCached: it is not in the cache; the call is counted.
        """
        config = self._client.config
        request = Request.of(config, messages, sampling)
        stored = None if self._cache is None else await self._cache.get(request.key)
        if stored is not None:
            completion = read_completion(stored.body, model=config.model, seconds=stored.seconds, cached=True)
            self.replies += 1
            self.reply_tokens += completion.completion_tokens or count_text(completion.text)
            return completion
        self.calls += 1
        self.prompt_tokens += count_messages(messages) + self._schema(request.sampling)
        raise NotCached("the reply is not in the cache, and a dry run makes no requests")

    def _schema(self, sampling: Sampling) -> int:
        """Tokens of the JSON schema of the reply."""
        form = sampling.extra_body.get("response_format")
        if form is None:
            return 0
        name = str(form.get("json_schema", form).get("name", ""))
        if name not in self._schemas:
            self._schemas[name] = count_text(msgspec.json.encode(form).decode())
        return self._schemas[name]


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """The estimate for one purpose.

    Attributes:
        purpose: what the model is used for.
        model: its name.
        things: number of tasks that need a request, as far as they are known.
        there: number of them whose request is finished.
        calls: estimated number of calls still to be made.
        prompt_tokens, reply_tokens: of these calls.
        dollars: their cost; ``None`` without a price.
        basis: how the numbers were obtained, in words.
    """

    purpose: Purpose
    model: str
    things: int
    there: int
    calls: int
    prompt_tokens: int
    reply_tokens: int
    dollars: float | None
    basis: str


@dataclass(frozen=True)
class Estimate:
    """The calls and the cost of the rest of a build."""

    lines: list[Line]

    def __str__(self) -> str:
        return printed(self.parts())

    def parts(self) -> Iterator[Table | str]:
        """The estimate as a table, and what it rests on."""
        columns = ("stage", "tasks", "done", "calls", "prompt tokens", "reply tokens", "dollars")
        fields = ("purpose", "things", "there", "calls", "prompt_tokens", "reply_tokens")
        rows = [
            (*(str(getattr(line, name)) for name in fields), _dollars(line.dollars)) for line in self.lines
        ]
        sums = (str(sum(getattr(line, name) for line in self.lines)) for name in fields[3:])
        yield Table("", columns, [*rows, ("all", "", "", *sums, _dollars(self.dollars))])
        yield from (f"{line.purpose} ({line.model}): {line.basis}" for line in self.lines if line.basis)

    @property
    def calls(self) -> int:
        """Total number of calls."""
        return sum(line.calls for line in self.lines)

    @property
    def dollars(self) -> float | None:
        """Total cost in dollars; ``None`` if a price is missing."""
        costs = [line.dollars for line in self.lines if line.calls]
        return None if None in costs else sum(cost for cost in costs if cost is not None)


def _dollars(value: float | None) -> str:
    return "?" if value is None else f"{value:,.2f}"


def estimate(
    build: Build, estimators: Mapping[Purpose, Estimator], models: Mapping[Purpose, str], prices: Prices
) -> Estimate:
    """Estimate the rest of a build that ran as far as the cache has replies.

    Calls that would be made now are counted. Calls that depend on missing replies are estimated by
    assumptions, or by measurements once there are enough replies
    (:class:`webgym.taskset.construction.config.Assumptions`).
    """
    return Estimate(
        [
            _line(build, purpose, estimator, models[purpose], prices)
            for purpose, estimator in estimators.items()
        ]
    )


def _line(build: Build, purpose: Purpose, estimator: Estimator, model: str, prices: Prices) -> Line:
    assumed, tally = build.config.assumptions, _tally(build, purpose)
    measured = tally.done >= MEASURED_FROM
    calls, prompt_tokens = float(estimator.calls), float(estimator.prompt_tokens)
    basis: list[str] = []
    things = tally.things
    if purpose in _LATER_PROMPTS:
        expected = derived = _expected_derived(build, basis)
        if purpose == "critic":  # what waits for the writer's reply is not among the calls counted so far
            expected += tally.pending - estimator.calls
        things += round(derived)
        calls += expected
        prompt_tokens += expected * _later_prompt(build, purpose)
    per_reply = assumed.reply_tokens[purpose]
    again = ASKED_AGAIN
    if measured:
        per_reply = round(estimator.reply_tokens / estimator.replies)
        again = max(0.0, estimator.replies / (tally.done + tally.failed) - 1)
    basis.append(
        f"{again:.0%} asked again, {per_reply} tokens a reply: {'measured' if measured else 'assumed'}"
    )
    prompt_tokens += again * (prompt_tokens + calls * per_reply)
    calls *= 1 + again
    reply_tokens = calls * per_reply
    price = prices.of(model)
    return Line(
        purpose=purpose,
        model=model,
        things=things,
        there=tally.done + tally.failed,
        calls=round(calls),
        prompt_tokens=round(prompt_tokens),
        reply_tokens=round(reply_tokens),
        dollars=None if price is None else price.dollars(round(prompt_tokens), round(reply_tokens)),
        basis="; ".join(basis) if calls else "",
    )


def _expected_derived(build: Build, basis: list[str]) -> float:
    """Estimated number of tasks that will be derived from tasks whose rubric is not written yet."""
    waiting = build.tallies["rubric"].pending + build.tallies["website"].pending
    missing = min(waiting, build.tallies["rubric"].things)
    if not missing:
        return 0.0
    parents = [row.came for row in build.accounting.rows if row.stage == "decomposition"]
    made = [row.made for row in build.accounting.rows if row.stage == "decomposition"]
    measured = sum(parents) >= MEASURED_FROM
    rate = sum(made) / sum(parents) if measured else DERIVED_PER_TASK
    basis.append(
        f"{rate:.2f} tasks derived from each of {missing:,}: {'measured' if measured else 'assumed'}"
    )
    return missing * rate


def _tally(build: Build, purpose: Purpose) -> Tally:
    """Counts of the requests for one purpose; the critic has one for every rubric and every derived task."""
    if purpose != "critic":
        return build.tallies[purpose]
    rubric, rewriting = build.tallies["rubric"], build.tallies["rewriting"]
    return Tally(*(getattr(rubric, name) + getattr(rewriting, name) for name in Tally.__struct_fields__))


def _later_prompt(build: Build, purpose: Purpose) -> float:
    """Average prompt tokens of a request that depends on missing replies."""
    sample = build.imported.tasks[:: max(1, len(build.imported.tasks) // 200)]
    instruction = sum(count_text(task.instruction) for task in sample) / max(1, len(sample))
    return count_text(_LATER_PROMPTS[purpose]) + instruction + _FACTS_TOKENS
