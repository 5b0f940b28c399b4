"""One small client for any endpoint that speaks the OpenAI chat API. It knows nothing of agents or judges."""

from webgym.llm.client import ChatClient, Completion
from webgym.llm.config import ChatConfig, Retry, Sampling

__all__ = ["ChatClient", "ChatConfig", "Completion", "Retry", "Sampling"]
