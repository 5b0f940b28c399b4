"""Settings of the egress proxy: its limits, with their units and reasons."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Final, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, field_validator, model_validator

from webgym.browser.egress.rules import read_rule
from webgym.core.settings import Settings

DIRECT: Final = "direct"
"""Name of the route without an upstream proxy."""


class UpstreamConfig(Settings):
    """An upstream proxy."""

    address: str
    """``http://HOST:PORT`` (a proxy that takes CONNECT) or ``socks5://HOST:PORT``."""

    credentials: str = ""
    """An environment variable, such as ``$PROXY``, or else a file that holds ``NAME:PASSWORD``. In the name,
    ``{session}`` becomes a word of the session's own, by which many providers choose an address for it."""

    resolve: Literal["there", "here"] = "there"
    """Where names are looked up. ``here``: the proxy gets addresses, all of which the policy has checked. It
    is for proxies that reach private networks, since ``there`` only names can be checked."""

    @field_validator("address")
    @classmethod
    def _is_an_address(cls, value: str) -> str:
        parts = urlsplit(value)
        if "@" in value:  # the message must not repeat it
            raise ValueError("a user name and a password belong into credentials")
        if parts.scheme not in ("http", "socks5") or not parts.hostname or parts.port is None:
            raise ValueError("it is no proxy's address, such as http://HOST:PORT or socks5://HOST:PORT")
        return f"{parts.scheme}://{parts.netloc}"

    @field_validator("credentials")
    @classmethod
    def _is_absolute(cls, value: str) -> str:
        return value if not value or value.startswith("$") else str(Path(value).absolute())


class EgressConfig(Settings):
    """What pages may connect to, how often, and with which deadlines."""

    allow: tuple[str, ...] = ()
    """Let pages connect to a name, address or network that is otherwise refused, or redirect a name:
    ``intranet.example``, ``10.0.0.0/8``, ``*.webgym.test=127.0.0.1:8123``. The first match decides.

    PATTERN is a name (``intranet.example``), the names below one (``*.webgym.test``), an address
    (``10.0.0.5``, ``[::1]``), a network (``10.0.0.0/8``) or ``*``. Pages may connect to a matching host,
    whatever address it has. ``=HOST:PORT`` redirects a name to that address instead, for every port;
    ``=nowhere`` makes it a name that does not exist.
    """

    block_lists: tuple[Annotated[Path, AfterValidator(Path.absolute)], ...] = ()
    """Files with hosts that no page may connect to, such as of trackers and adverts, in the hosts format
    (``0.0.0.0 ads.example``), on the machine of the browsers. They go before ``allow``."""

    ports: tuple[int, ...] = (80, 443, 8080, 8443)
    """Ports that pages may connect to on hosts that no rule allows; an empty list allows all."""

    upstream: dict[str, UpstreamConfig] = Field(default_factory=dict)
    """Proxies, by names of your choice, one of which carries all connections of a session. Sessions take them
    in turn; one that fails is left out for a while."""

    routes: tuple[str, ...] = ()
    """Routes of single hosts, ``PATTERN[:PORT]=NAME``, with the patterns of ``allow`` and a name of
    ``upstream`` or ``direct``. The first match decides. What ``allow`` redirects is connected to directly."""

    # --- deadlines, seconds -----------------------------------------------------------------------

    connect_seconds: float = Field(default=8.0, gt=0)
    """Connecting to one of the addresses, all attempts together. Less than ``browser.navigate_seconds``
    together with the time for resolving the name, so that the reason is known before the navigation times
    out."""

    dead_seconds: int = Field(default=120, gt=0)
    """Time without any acknowledgement after which a server counts as gone."""

    # --- one session ------------------------------------------------------------------------------

    session_lookups: int = Field(default=64, gt=0)
    """Concurrent lookups of one session. A newspaper's page with its advertisements needs 40."""

    session_names: int = Field(default=4096, gt=0)
    """Different names that one session looks up in total."""

    session_connections: int = Field(default=512, gt=0)
    """Concurrent connections of one session, including those being opened. Chromium's own limits are 256, and
    255 WebSockets."""

    session_bytes: int = Field(default=8 * 2**30, gt=0)
    """Bytes forwarded for one session, in both directions: two hours of video."""

    # --- politeness -------------------------------------------------------------------------------

    rate: float = Field(default=20.0, gt=0)
    """Average rate of new connections to one host, per second, of all sessions together; to a host that does
    not belong to the page's website, such as a shared CDN, of all sessions at that website. Hosts that a rule
    allows are exempt."""

    burst: int = Field(default=120, gt=0)
    """New connections to one host at once, after a pause: 20 sessions that open its page together."""

    wait_seconds: float = Field(default=4.0, ge=0)
    """Longest delay of a connection by the rate limit; one that would wait longer is refused."""

    @field_validator("allow")
    @classmethod
    def _are_rules(cls, rules: tuple[str, ...]) -> tuple[str, ...]:
        for rule in rules:
            read_rule(rule)
        return rules

    @model_validator(mode="after")
    def _routes_exist(self) -> EgressConfig:
        if wrong := [name for name in self.upstream if name == DIRECT or not re.fullmatch(r"[\w.-]+", name)]:
            raise ValueError(f"{wrong[0]!r} cannot be the name of an upstream proxy")
        for route in self.routes:
            pattern, _, name = route.rpartition("=")
            read_rule(pattern)
            if name not in (DIRECT, *self.upstream):
                raise ValueError(f"{route!r} is no route: {name!r} is not among the upstream proxies")
        return self

    def allowing(self, *rules: str) -> EgressConfig:
        """A copy with these rules before the others."""
        return self.model_validate({**self.model_dump(), "allow": (*rules, *self.allow)})
