"""Settings of clients: endpoint, model, sampling, deadlines, retries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import urlsplit

from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer

from webgym.core.settings import Settings

_RESERVED_FIELDS: Final = frozenset({"messages", "model", "stream", "n"})
"""Fields that the client sets itself; ``extra_body`` must not change them."""


_NEUTRAL: Final[dict[str, float]] = {"top_p": 1, "top_k": -1, "typical_p": 1, "repetition_penalty": 1}
"""Values of sampling parameters that do not alter the model's distribution; 0 and empty values never do."""
_HARMLESS: Final = frozenset(
    "temperature max_tokens max_completion_tokens max_new_tokens seed sampling_seed stop stop_token_ids "
    "no_stop_trim include_stop_str_in_output skip_special_tokens spaces_between_special_tokens logprobs "
    "top_logprobs return_token_ids return_weight_versions chat_template chat_template_kwargs user metadata "
    "store priority".split()
)
"""Fields that leave the distribution of a token after its prompt as it is, apart from the temperature."""


def altering(sampling: Mapping[str, Any]) -> list[str]:
    """The parameters that alter the model's distribution, or may do so, apart from the temperature.

    Args:
        sampling: fields of a request, as :meth:`Sampling.body` returns them.
    """
    return [
        name
        for name, value in sampling.items()
        if value and name not in _HARMLESS and value != _NEUTRAL.get(name)
    ]


class Sampling(Settings):
    """Sampling parameters. A parameter that is ``None`` is not sent, so that the endpoint's default
    applies."""

    temperature: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """Temperature; 0 for the likeliest tokens."""

    top_p: float | None = Field(default=None, gt=0, le=1)
    """Share of the probability mass to sample from."""

    max_tokens: int | None = Field(default=None, ge=1)
    """Longest reply, in tokens."""

    extra_body: dict[str, Any] = Field(default_factory=dict)
    """Further fields of the request that only some endpoints support (``top_k``, ``seed``, ...). ``None``
    removes a field of the defaults."""

    sample: int = Field(default=0, ge=0)
    """Index among several replies to the same request. It is not sent, but part of the cache key, so that
    samples 0, 1, 2 of one request are three calls, each paid once."""

    @field_validator("extra_body")
    @classmethod
    def _sets_no_reserved_field(cls, extra: dict[str, Any]) -> dict[str, Any]:
        if conflicts := _RESERVED_FIELDS & extra.keys():
            raise ValueError(f"extra_body must not set {', '.join(sorted(conflicts))}")
        return extra

    @model_serializer(mode="wrap")
    def _as_set(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Those that are set: one that is stored as ``None`` would remove a default when it is read again."""
        return {name: value for name, value in dump(self).items() if name in self.model_fields_set}

    def over(self, base: Sampling) -> Sampling:
        """These parameters over defaults, one by one, including those in ``extra_body``.

        Parameters that are set here override the defaults; one set to ``None`` removes the default.
        """
        changes = {name: getattr(self, name) for name in self.model_fields_set}
        if base.extra_body or self.extra_body:
            changes["extra_body"] = base.extra_body | self.extra_body
        return base.model_copy(update=changes)

    def body(self) -> dict[str, Any]:
        """The fields of the request, exactly as they are sent."""
        further = {name: value for name, value in self.extra_body.items() if value is not None}
        return self.model_dump(exclude={"extra_body", "sample"}, exclude_none=True) | further


class Retry(Settings):
    """Retries after a refused or broken connection, 408, 429 and 5xx; never after a timeout.

    Before try n + 1 there is a pause of ``first_seconds * 2**(n-1)``, at most ``longest_seconds``, shortened
    by a random amount of up to half, so that clients do not retry at the same time. ``Retry-After`` makes it
    longer. Once the endpoint has answered a request, 404, other 5xx but 501, and what is no completion are
    temporary, too.
    """

    tries: int = Field(default=5, ge=1)
    """Most tries of a request. Those during ``patience_seconds`` do not count."""

    patience_seconds: float = Field(default=300.0, ge=0)
    """How long an endpoint that has worked before, and now answers no request at all, is waited for. One that
    has never worked is not."""

    refused_tries: int = Field(default=15, ge=1)
    """Most tries if every answer is 429, 503 or 529: the endpoint works but is overloaded, and rate limits
    per minute take more than a few tries. The deadline of the complete reply still applies."""

    first_seconds: float = Field(default=0.5, ge=0)
    """The first pause."""

    longest_seconds: float = Field(default=20.0, ge=0)
    """The longest pause, except for ``Retry-After``."""


class ChatConfig(Settings):
    """An endpoint, a model, and limits of requests to them."""

    base_url: str
    """OpenAI-compatible endpoint, without ``/chat/completions``, e.g. ``http://127.0.0.1:8000/v1``. Its key:
    WEBGYM_API_KEY."""

    model: str = Field(min_length=1)
    """Name of the model at that endpoint."""

    any_model: bool = False
    """Accept replies of several models, as of a router with several snapshots under one name. Otherwise a
    reply that names another model than the first reply did is an error of the endpoint."""

    api_key_env: str = "WEBGYM_API_KEY"
    """Environment variable with the API key. If it is not set, no key is sent. The key itself is never part
    of a config, so that it is not stored in run folders."""

    sampling: Sampling = Sampling()
    """Default sampling parameters of requests."""

    concurrency: int = Field(default=32, ge=1)
    """Most requests in flight; others wait, which does not count towards deadlines."""

    connect_seconds: float = Field(default=10.0, gt=0)
    """Deadline for opening a connection."""

    read_seconds: float = Field(default=300.0, gt=0)
    """Longest time without receiving data. Without streaming, nothing is received until the reply is
    complete."""

    total_seconds: float = Field(default=600.0, gt=0)
    """Deadline for the complete reply, including retries and pauses, except ``retry.patience_seconds``."""

    retry: Retry = Retry()
    """When a request is sent again."""

    @field_validator("base_url")
    @classmethod
    def _is_plain_http(cls, value: str) -> str:
        try:
            url = urlsplit(value.strip().rstrip("/"))
            is_complete = url.hostname and url.port != 0
        except ValueError as error:
            raise ValueError(f"{value!r} is not a URL") from error
        if url.scheme not in ("http", "https") or not is_complete:
            raise ValueError("the base URL must start with http:// or https:// and name a host")
        if "@" in url.netloc or url.query or url.fragment:
            raise ValueError("the base URL must not contain credentials, a query or a fragment")
        return url.geturl()
