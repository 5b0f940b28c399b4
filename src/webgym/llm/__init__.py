"""One small client for any endpoint that speaks the OpenAI chat API. It knows nothing of agents or judges."""

from webgym.core.errors import BudgetSpent, CacheError, LLMUnusable, NotCached
from webgym.llm.batch import BatchFile, Collector, Imported, import_results, write_batches
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient, EndpointRefused
from webgym.llm.completion import Completes, Completion
from webgym.llm.config import AdaptiveConcurrency, BatchLimits, CacheLimits, ChatConfig, Retry, Sampling
from webgym.llm.ledger import Budget, Ledger
from webgym.llm.prices import Price, Prices
from webgym.llm.structured import ask_for
from webgym.llm.tokens import count_messages, count_text
from webgym.llm.usage import Call, Totals, Usage

__all__ = [
    "AdaptiveConcurrency",
    "BatchFile",
    "BatchLimits",
    "Budget",
    "BudgetSpent",
    "CacheError",
    "CacheLimits",
    "Call",
    "ChatClient",
    "ChatConfig",
    "Collector",
    "Completes",
    "Completion",
    "EndpointRefused",
    "Imported",
    "LLMUnusable",
    "Ledger",
    "NotCached",
    "Price",
    "Prices",
    "ReplyCache",
    "Retry",
    "Sampling",
    "Totals",
    "Usage",
    "ask_for",
    "count_messages",
    "count_text",
    "import_results",
    "write_batches",
]
