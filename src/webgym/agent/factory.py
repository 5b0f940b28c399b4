"""Creates a policy by its name."""

from __future__ import annotations

from typing import Final

from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.policy import Policy
from webgym.agent.profile import Profile
from webgym.agent.scripted import RandomPolicy, ScriptedPolicy
from webgym.core.errors import ConfigError
from webgym.llm.config import ChatConfig

POLICY_NAMES: Final = ("scripted", "random", "openai")


def create_policy(
    name: str, *, mistake_rate: float = 0.0, chat: ChatConfig | None = None, profile: Profile | None = None
) -> Policy:
    """The policy of this name.

    Args:
        name: one of :data:`POLICY_NAMES`.
        mistake_rate: for ``scripted``: share of attempts with a mistake.
        chat: for ``openai``: endpoint and model.
        profile: for ``openai``: profile of the model family; by default chosen by the model's name.

    Raises:
        ConfigError: the policy is unknown, or ``openai`` is given no endpoint.
    """
    match name:
        case "scripted":
            return ScriptedPolicy(mistake_rate)
        case "random":
            return RandomPolicy()
        case "openai":
            if chat is None:
                hint = "give a base URL and the model's name"
                raise ConfigError("the openai policy does not know its endpoint", hint=hint)
            return OpenAIPolicy(chat, profile)
        case _:
            raise ConfigError(f"unknown policy {name!r}", hint=f"choose one of {', '.join(POLICY_NAMES)}")
