"""From observation to action: prompts, context window, memory, parsing, policies (paper §5)."""

from webgym.agent.agent import Agent, Conversation
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.factory import POLICY_NAMES, create_policy
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.parser import ParsedReply, ParseError, parse_reply
from webgym.agent.policy import Player, Policy, Turn
from webgym.agent.random_policy import RandomPolicy
from webgym.agent.scripted import ScriptedPolicy

__all__ = [
    "POLICY_NAMES",
    "Agent",
    "AgentConfig",
    "Conversation",
    "OpenAIPolicy",
    "ParseError",
    "ParsedReply",
    "Player",
    "Policy",
    "PromptFormat",
    "RandomPolicy",
    "ScriptedPolicy",
    "Turn",
    "create_policy",
    "parse_reply",
]
