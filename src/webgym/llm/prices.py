"""Prices of tokens. WebGym contains no prices itself: they change, and a wrong price is worse than none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import yaml
from pydantic import Field

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings, validated
from webgym.llm.completion import Completion
from webgym.llm.tokens import count_text
from webgym.llm.usage import Call

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
