"""One small client for any endpoint that speaks the OpenAI chat API. It knows nothing of agents or judges."""
