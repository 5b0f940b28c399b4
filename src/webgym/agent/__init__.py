"""From observation to action: prompts, context window, memory, parsing, policies (paper §5)."""
