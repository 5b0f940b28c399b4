"""Settings of clients: endpoint, model, sampling, deadlines, retries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import Field, field_validator

from webgym.settings import Settings

_OURS: Final = frozenset({"messages", "model", "stream", "n"})
"""What a request says by itself; ``extra_body`` cannot change it."""


_NEUTRAL: Final[dict[str, tuple[float, ...]]] = {
    "top_p": (0, 1),  # 0 stands for a parameter that is not there
    "top_k": (0, -1),
    "min_p": (0,),
    "presence_penalty": (0,),
    "frequency_penalty": (0,),
    "repetition_penalty": (0, 1),
}
"""Values of sampling parameters that leave the model's distribution as it is, but for the temperature."""


def altering(sampling: Mapping[str, Any]) -> list[str]:
    """Which of these parameters, the temperature aside, make the distribution another than the model's own.

    Args:
        sampling: fields of a request, as :meth:`Sampling.body` gives them.
    """
    found = [name for name, neutral in _NEUTRAL.items() if (sampling.get(name) or 0) not in neutral]
    return found + (["logit_bias"] if sampling.get("logit_bias") else [])


class Sampling(Settings):
    """Sampling parameters. What is ``None`` is not sent, and the endpoint's default holds."""

    temperature: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """0 for the likeliest tokens."""

    top_p: float | None = Field(default=None, gt=0, le=1)
    """Share of the probability mass that tokens are drawn from."""

    max_tokens: int | None = Field(default=None, ge=1)
    """Longest reply, in tokens."""

    extra_body: dict[str, Any] = Field(default_factory=dict)
    """Further fields of the request, for what only some endpoints know (``top_k``, ``seed``, ...). ``None``
    leaves one out that would be there otherwise."""

    sample: int = Field(default=0, ge=0)
    """Which of several replies to the same request is meant. Never sent: it only tells the cache that
    another draw is wanted, so that samples 0, 1, 2 of one request are three calls, each paid once."""

    @field_validator("extra_body")
    @classmethod
    def _leaves_ours_alone(cls, extra: dict[str, Any]) -> dict[str, Any]:
        if taken := _OURS & extra.keys():
            raise ValueError(f"extra_body must not set {', '.join(sorted(taken))}")
        return extra

    def over(self, base: Sampling) -> Sampling:
        """These parameters laid over others, key by key, ``extra_body`` too.

        What is set here holds, ``None`` included, which takes a parameter of the base away; the rest is the
        base's.
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
    """What is tried again: a refused or broken connection, 408, 429 and 5xx. Never a timeout.

    Before try n + 1 there is a pause of ``first_seconds * 2**(n-1)``, at most ``longest_seconds``, of which
    a random half is left out so that clients do not come back in step. ``Retry-After`` makes it longer.
    """

    tries: int = Field(default=5, ge=1)
    """How often a request is sent at most."""

    refused_tries: int = Field(default=15, ge=1)
    """How often it is sent at most if every answer is 429, 503 or 529: the endpoint is well but busy, and
    limits per minute outlast a few tries. The deadline for the complete reply holds all the same."""

    first_seconds: float = Field(default=0.5, ge=0)
    """The first pause."""

    longest_seconds: float = Field(default=20.0, ge=0)
    """No pause of our own is longer."""


class AdaptiveConcurrency(Settings):
    """How many requests are in flight, by what the endpoint bears; see :mod:`webgym.llm.adaptive`."""

    first: int = Field(default=16, ge=1)
    """Requests in flight to begin with. Twice as many per round trip until the first sign of trouble."""

    shrink: float = Field(default=0.7, gt=0, le=1)
    """What is left after 429, 503, 529 or a timeout; 1 keeps the concurrency as it is."""

    slower: float = Field(default=3.0, gt=1)
    """How much slower than at its best the endpoint may be before there are fewer. A server that batches
    is two to three times slower per reply at its highest throughput than for a single request."""

    round_replies: int = Field(default=8, ge=1)
    """Fewest replies whose median counts as the endpoint's present speed."""


class ChatConfig(Settings):
    """An endpoint, a model, and how patient to be with them."""

    base_url: str
    """OpenAI-compatible endpoint, without ``/chat/completions``, e.g. ``http://127.0.0.1:8000/v1``. Its key:
    WEBGYM_API_KEY."""

    model: str = Field(min_length=1)
    """Name of the model at that endpoint."""

    api_key_env: str = "WEBGYM_API_KEY"
    """Environment variable that holds the key. If it is not set, none is sent. The key itself is never
    part of a config, so that no run folder can hold it."""

    sampling: Sampling = Sampling()
    """Holds for what a request's own sampling does not say."""

    concurrency: int = Field(default=32, ge=1)
    """Most requests in flight at the same time; others wait, which counts towards no deadline."""

    adapt: AdaptiveConcurrency = AdaptiveConcurrency()
    """How many of these are used, by how the endpoint bears it."""

    connect_seconds: float = Field(default=10.0, gt=0)
    """Deadline for a connection."""

    read_seconds: float = Field(default=300.0, gt=0)
    """Longest silence of the endpoint. A model that thinks is silent until its reply is complete."""

    total_seconds: float = Field(default=600.0, gt=0)
    """Deadline for the complete reply, tries and pauses included."""

    max_reply_bytes: int = Field(default=8 * 1024 * 1024, ge=1024)
    """A longer reply is cut off and refused."""

    retry: Retry = Retry()
    """When to ask again."""

    @field_validator("base_url")
    @classmethod
    def _is_plain_http(cls, value: str) -> str:
        import httpx  # takes longer than all settings together, and most commands ask no model

        try:
            url = httpx.URL(value.strip().rstrip("/"))
        except httpx.InvalidURL as error:
            raise ValueError(f"{value!r} is not a URL") from error
        if url.scheme not in ("http", "https") or not url.host:
            raise ValueError("the base URL must start with http:// or https:// and name a host")
        if url.userinfo or url.query or url.fragment:
            raise ValueError("the base URL must hold no credentials, query or fragment")
        return str(url)


class CacheLimits(Settings):
    """How the file of replies is used."""

    busy_seconds: float = Field(default=30.0, ge=0)
    """How long to wait while another process writes."""

    group: int = Field(default=1000, ge=1)
    """Most replies that are read, or written with one sync, at a time."""


class BatchLimits(Settings):
    """What a file of a batch may hold; those of the OpenAI batch API."""

    requests: int = Field(default=50_000, ge=1)
    """Most requests in a file."""

    file_bytes: int = Field(default=200_000_000, ge=1)
    """Largest file."""

    url: str = "/v1/chat/completions"
    """What every line names as its address."""
