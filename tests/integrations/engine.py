"""An inference engine that samples what it is told to, in ids of the tiny tokenizer."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import webgym
from webgym.agent.formats import render_reply
from webgym.core.action import Action

if TYPE_CHECKING:  # torch, which only some frameworks bring
    from webgym import Renderer, Sampled, TokenRequest


def reply_text(action: Action) -> str:
    """An action as a model of the stand-in environment writes it."""
    return render_reply(action, "memory", description="")


def texts_of(actions: Sequence[Action | str]) -> list[str]:
    """Actions as :func:`reply_text` writes them, replies as they are."""
    return [each if isinstance(each, str) else reply_text(each) for each in actions]


class Engine:
    """Says one thing after another; the last again and again.

    Attributes:
        requests: what it was asked.
        version: of its weights.
    """

    def __init__(self, renderer: Renderer, texts: Sequence[str], version: str = "7") -> None:
        self._renderer, self._texts = renderer, list(texts)
        self.requests: list[TokenRequest] = []
        self.version = version
        self.change: Callable[[Sampled], Sampled] = lambda sampled: sampled

    def sample(self, text: str) -> tuple[list[int], list[float]]:
        """Ids of a text with the end token, and log-probabilities."""
        tokenizer = self._renderer.tokenizer
        ids = [*tokenizer(text, add_special_tokens=False)["input_ids"], tokenizer.eos_token_id]
        return ids, [-0.25 - place / 1024 for place in range(len(ids))]

    async def __call__(self, request: TokenRequest) -> Sampled:
        place = min(len(self.requests), len(self._texts) - 1)
        self.requests.append(request)
        ids, logprobs = self.sample(self._texts[place])
        return self.change(webgym.Sampled(ids, logprobs, weight_version=self.version))


def example(name: str) -> Any:
    """The module of an example, anew."""
    path = Path(__file__).parents[2] / "examples" / "integrations" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
