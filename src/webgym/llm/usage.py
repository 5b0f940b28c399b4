"""Usage and cost of models, per purpose and model."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec


class Call(msgspec.Struct, frozen=True, gc=False):
    """A call that was paid for.

    Attributes:
        purpose: what it was for, as the caller labelled it; may be empty.
        model: as it was asked for.
        prompt_tokens, completion_tokens: as the endpoint counted them, else estimated.
        prompt_tokens_cached: how many of the prompt's tokens the endpoint had read before.
        dollars: what it cost by the prices of the time; ``None`` if the model's price was not known.
        is_estimate: whether the tokens are our own estimate, as the endpoint did not count them.
        batch: the endpoint's id of the request if it was answered in a batch; else empty.
    """

    purpose: str
    model: str
    prompt_tokens: int
    completion_tokens: int
    prompt_tokens_cached: int = 0
    dollars: float | None = None
    is_estimate: bool = False
    batch: str = ""


class Usage(msgspec.Struct, gc=False):
    """A sum over calls.

    Attributes:
        calls: how many were paid for.
        hits: how many were answered from the cache.
        batched: how many of the paid ones were answered in a batch.
        prompt_tokens, completion_tokens, prompt_tokens_cached: of the paid ones.
        dollars: of those whose price was known.
        unpriced: how many paid ones had no price.
        estimated: for how many the endpoint did not count tokens.
    """

    calls: int = 0
    hits: int = 0
    batched: int = 0
    prompt_tokens: int = 0
    prompt_tokens_cached: int = 0
    completion_tokens: int = 0
    dollars: float = 0.0
    unpriced: int = 0
    estimated: int = 0

    @property
    def tokens(self) -> int:
        """Of prompts and replies together."""
        return self.prompt_tokens + self.completion_tokens

    def add(self, other: Usage) -> None:
        """Count another sum in."""
        for name in self.__struct_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


class Totals:
    """Sums per purpose and model, and over all.

    Attributes:
        all: over everything.
    """

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], Usage] = {}
        self.all = Usage()

    @property
    def rows(self) -> Mapping[tuple[str, str], Usage]:
        """Sums by ``(purpose, model)``."""
        return self._rows

    def add(self, purpose: str, model: str, usage: Usage) -> None:
        """Count a sum in."""
        self._rows.setdefault((purpose, model), Usage()).add(usage)
        self.all.add(usage)

    def paid(self, call: Call) -> None:
        """Count a paid call in."""
        self.add(
            call.purpose,
            call.model,
            Usage(
                calls=1,
                batched=int(bool(call.batch)),
                prompt_tokens=call.prompt_tokens,
                prompt_tokens_cached=call.prompt_tokens_cached,
                completion_tokens=call.completion_tokens,
                dollars=call.dollars or 0.0,
                unpriced=int(call.dollars is None),
                estimated=int(call.is_estimate),
            ),
        )

    def hit(self, purpose: str, model: str, count: int = 1) -> None:
        """Count calls that were answered from the cache in."""
        self.add(purpose, model, Usage(hits=count))
