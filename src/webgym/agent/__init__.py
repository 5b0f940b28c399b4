"""From observation to action: prompts, context window, memory, parsing, policies (paper §5)."""

from webgym.agent.agent import Agent, Conversation
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.factory import POLICY_NAMES, create_policy
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.parser import ParsedReply, ParseError, parse_reply
from webgym.agent.policy import Policy, PolicyInput, PolicySession
from webgym.agent.profile import Profile
from webgym.agent.profiles import GENERIC, all_profiles, choose_profile, profile_of
from webgym.agent.random_policy import RandomPolicy
from webgym.agent.request import request_of
from webgym.agent.scripted import ScriptedPolicy

__all__ = [
    "GENERIC",
    "POLICY_NAMES",
    "Agent",
    "AgentConfig",
    "Conversation",
    "OpenAIPolicy",
    "ParseError",
    "ParsedReply",
    "Policy",
    "PolicyInput",
    "PolicySession",
    "Profile",
    "PromptFormat",
    "RandomPolicy",
    "ScriptedPolicy",
    "all_profiles",
    "choose_profile",
    "create_policy",
    "parse_reply",
    "profile_of",
    "request_of",
]
