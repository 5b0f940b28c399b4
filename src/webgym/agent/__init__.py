"""From observation to action: prompts, context window, memory, parsing, policies (paper §5)."""

from webgym.agent.agent import Agent, Conversation
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.parser import ParsedReply, ParseError, parse_reply
from webgym.agent.policy import Player, Policy, Turn
from webgym.agent.scripted import ScriptedPolicy

__all__ = [
    "Agent",
    "AgentConfig",
    "Conversation",
    "ParseError",
    "ParsedReply",
    "Player",
    "Policy",
    "PromptFormat",
    "ScriptedPolicy",
    "Turn",
    "parse_reply",
]
