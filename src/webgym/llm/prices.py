"""Calls that were paid for, their sums per purpose and model, and the prices of tokens.

WebGym contains no prices itself: they change, and a wrong price is worse than none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec
import yaml
from pydantic import Field

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings, validated
from webgym.core.tables import Table, printed
from webgym.llm.completion import Completion
from webgym.llm.tokens import count_text


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

    def __str__(self) -> str:
        return printed(self.parts())

    def parts(self) -> Iterator[Table | str]:
        """The sums as a table, and what is not in the dollars or is estimated."""
        columns = {
            "calls": "calls",
            "in batches": "batched",
            "from cache": "hits",
            "prompt": "prompt_tokens",
            "of it cached": "prompt_tokens_cached",
            "completion": "completion_tokens",
        }
        rows = [
            (
                purpose or "-",
                model,
                *(str(getattr(usage, name)) for name in columns.values()),
                "unknown" if usage.calls and usage.calls == usage.unpriced else f"{usage.dollars:,.4f}",
            )
            for (purpose, model), usage in [*sorted(self._rows.items()), (("all", ""), self.all)]
        ]
        yield Table("", ("purpose", "model", *columns, "dollars"), rows, names=2)
        if self.all.unpriced:
            yield f"{self.all.unpriced:,} calls had no price and are not included in the dollars"
        if self.all.estimated:
            yield f"the tokens of {self.all.estimated:,} calls are estimates"


_MILLION: Final = 1_000_000
_ANY: Final = "*"
_HINT: Final = "write PROMPT,COMPLETION or PROMPT,CACHED,COMPLETION, in dollars per million tokens"


class Price(Settings):
    """The price of one model, in dollars per million tokens."""

    prompt: float = Field(ge=0, allow_inf_nan=False)
    """Price of the prompt's tokens."""

    completion: float = Field(ge=0, allow_inf_nan=False)
    """Price of the reply's tokens, including those of thinking."""

    cached: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """Price of prompt tokens in the endpoint's own cache; by default the same as of others."""

    batch: float = Field(default=1.0, ge=0, le=1)
    """Factor of all prices in a batch; 0.5 for endpoints that sell batches at half the price."""

    def dollars(
        self, prompt_tokens: int, completion_tokens: int, *, cached_tokens: int = 0, in_batch: bool = False
    ) -> float:
        """Cost of a call in dollars; ``prompt_tokens`` include ``cached_tokens``."""
        cached = self.prompt if self.cached is None else self.cached
        cost = (prompt_tokens - cached_tokens) * self.prompt + cached_tokens * cached
        cost += completion_tokens * self.completion
        return cost * (self.batch if in_batch else 1.0) / _MILLION


class Prices:
    """Prices by the model's name in requests. The name ``*`` applies to every other model."""

    def __init__(self, by_model: dict[str, Price] | None = None) -> None:
        self._by_model = dict(by_model or {})

    def __contains__(self, model: str) -> bool:
        return self.of(model) is not None

    def of(self, model: str) -> Price | None:
        """A model's price, if it is known."""
        return self._by_model.get(model, self._by_model.get(_ANY))

    def call(
        self, purpose: str, model: str, completion: Completion, prompt: Callable[[], int], *, batch: str = ""
    ) -> Call:
        """The record of a paid call.

        Args:
            purpose: the caller's label.
            model: the requested model.
            completion: the reply.
            prompt: estimates the prompt's tokens; called if the endpoint counted none.
            batch: the endpoint's id of the request, if it was answered in a batch.
        """
        tokens = completion.prompt_tokens, completion.completion_tokens
        cached = completion.prompt_tokens_cached
        is_estimate = not any(tokens)
        if is_estimate:
            tokens = prompt(), count_text(completion.text)
        dollars = None
        if (price := self.of(model)) is not None:
            dollars = price.dollars(*tokens, cached_tokens=cached, in_batch=bool(batch))
        return Call(purpose, model, *tokens, cached, dollars, is_estimate, batch)

    @classmethod
    def read(cls, path: Path) -> Prices:
        """Prices from a YAML file of ``MODEL: {prompt: 2.5, cached: 1.25, completion: 10, batch: 0.5}``.

        Raises:
            ConfigError: the file cannot be read, or has another form.
        """
        try:
            table = yaml.safe_load(path.read_text("utf-8"))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            reason = " ".join(str(error).split())
            raise ConfigError(f"the prices in {path} cannot be read: {reason}") from error
        if not isinstance(table, dict) or not all(isinstance(model, str) for model in table):
            hint = "write MODEL: {prompt: ..., completion: ...}, in dollars per million tokens"
            raise ConfigError(f"{path} is not a table of prices", hint=hint)
        return cls(
            {
                model: validated(Price, entry, f"the price of {model} in {path}")
                for model, entry in table.items()
            }
        )

    @classmethod
    def parse(cls, text: str) -> Prices:
        """One price for every model, as on the command line: ``2.5,10`` or ``2.5,1.25,10``.

        The numbers are dollars per million tokens of prompt (, of cached prompt) and of completion.

        Raises:
            ConfigError: the text is not a price.
        """
        try:
            numbers = [float(part) for part in text.split(",")]
            if len(numbers) not in (2, 3):
                raise ConfigError(f"{text!r} is not a price", hint=_HINT)
            cached = numbers[1] if len(numbers) == 3 else None
            price = Price(prompt=numbers[0], cached=cached, completion=numbers[-1])
        except ValueError as error:  # also pydantic's ValidationError
            raise ConfigError(f"{text!r} is not a price", hint=_HINT) from error
        return cls({_ANY: price})
