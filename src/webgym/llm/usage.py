"""Usage and cost of models, per purpose and model."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec


class Call(msgspec.Struct, frozen=True, gc=False):
    """A call that was paid for.

    Attributes:
        purpose: the caller's label of the call; may be empty.
        model: the requested model.
        prompt_tokens, completion_tokens: as the endpoint counted them, else estimated.
        prompt_tokens_cached: how many of the prompt's tokens were in the endpoint's own cache.
        dollars: its cost by the prices at that time; ``None`` if the model's price was not known.
        is_estimate: whether the token counts are estimated, because the endpoint did not count them.
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
        calls: number of paid calls.
        hits: number of calls answered from the cache.
        batched: number of paid calls answered in a batch.
        prompt_tokens, completion_tokens, prompt_tokens_cached: tokens of the paid calls.
        dollars: cost of the paid calls with a known price.
        unpriced: number of paid calls without a known price.
        estimated: number of paid calls whose token counts are estimated.
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
        """Tokens of prompts and replies together."""
        return self.prompt_tokens + self.completion_tokens

    def add(self, other: Usage) -> None:
        """Add another sum."""
        for name in self.__struct_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


class Totals:
    """Sums per purpose and model, and over all.

    Attributes:
        all: the sum over all purposes and models.
    """

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], Usage] = {}
        self.all = Usage()

    @property
    def rows(self) -> Mapping[tuple[str, str], Usage]:
        """Sums by ``(purpose, model)``."""
        return self._rows

    def add(self, purpose: str, model: str, usage: Usage) -> None:
        """Add a sum."""
        self._rows.setdefault((purpose, model), Usage()).add(usage)
        self.all.add(usage)

    def paid(self, call: Call) -> None:
        """Add a paid call."""
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
        """Add calls that were answered from the cache."""
        self.add(purpose, model, Usage(hits=count))
