"""Every limit of the egress proxy, with its unit and its reason."""

from __future__ import annotations

from pydantic import Field, field_validator

from webgym.browser.egress.rules import read_rule
from webgym.settings import Settings


class EgressConfig(Settings):
    """What pages may connect to, how often, and how long it may take."""

    allow: tuple[str, ...] = ()
    """Let pages connect to a name, address or network that is otherwise refused, or lead a name elsewhere:
    ``intranet.example``, ``10.0.0.0/8``, ``*.webgym.test=127.0.0.1:8123``. The first match decides.

    PATTERN is a name (``intranet.example``), the names below one (``*.webgym.test``), an address
    (``10.0.0.5``, ``[::1]``), a network (``10.0.0.0/8``) or ``*``. A host that matches may be connected to
    whatever address it has. ``=HOST:PORT`` leads a name to that place instead, whatever port was asked
    for; ``=nowhere`` makes it a name that does not exist.
    """

    ports: tuple[int, ...] = (80, 443, 8080, 8443)
    """Ports that may be connected to on hosts that no rule allows; none named permits all."""

    # --- deadlines, seconds -----------------------------------------------------------------------

    handshake_seconds: float = Field(default=3600.0, gt=0)
    """Until a browser has said where it wants to go. Long, as it may be frozen in the middle of it."""

    resolve_seconds: float = Field(default=5.0, gt=0)
    """A name to its addresses."""

    connect_seconds: float = Field(default=8.0, gt=0)
    """Addresses to a connection, all attempts together. With ``resolve_seconds`` less than
    ``browser.navigate_seconds``, so that the reason is known before the navigation is given up."""

    attempt_seconds: float = Field(default=2.5, gt=0)
    """One address out of several; the last one has the time that is left."""

    keepalive_seconds: int = Field(default=60, gt=0)
    """Silence after which a server is asked whether it is still there."""

    dead_seconds: int = Field(default=120, gt=0)
    """A server that acknowledges nothing for so long is gone."""

    # --- names ------------------------------------------------------------------------------------

    cache_seconds: float = Field(default=30.0, ge=0)
    """How long a lookup's result is used again. The check of the address is made at every connection."""

    cache_names: int = Field(default=4096, gt=0)
    """Names kept in the cache, and failures kept to be told."""

    # --- one session ------------------------------------------------------------------------------

    session_lookups: int = Field(default=64, gt=0)
    """Names that one session looks up at once. A page of a newspaper with its advertisements asks for 40."""

    session_names: int = Field(default=4096, gt=0)
    """Different names that one session asks for, from its beginning to its end."""

    session_connections: int = Field(default=512, gt=0)
    """Connections of one session at once, those included that are being made. Chromium itself keeps to 256,
    and to 255 WebSockets."""

    session_bytes: int = Field(default=8 * 2**30, gt=0)
    """Passed on for one session, in both directions: two hours of video."""

    # --- politeness -------------------------------------------------------------------------------

    rate: float = Field(default=20.0, gt=0)
    """New connections per second to one host, of all sessions together, in the long run. Hosts that a
    rule allows are exempt."""

    burst: int = Field(default=120, gt=0)
    """New connections to one host at once, after a pause: 20 sessions that open its page together."""

    wait_seconds: float = Field(default=4.0, ge=0)
    """A connection that would have to wait for longer is refused."""

    # --- bytes ------------------------------------------------------------------------------------

    buffer_bytes: int = Field(default=256 * 1024, gt=0)
    """Unsent bytes per direction above which the sender is no longer read from: a frozen browser reads
    nothing for minutes."""

    @field_validator("allow")
    @classmethod
    def _are_rules(cls, rules: tuple[str, ...]) -> tuple[str, ...]:
        for rule in rules:
            read_rule(rule)
        return rules

    def allowing(self, *rules: str) -> EgressConfig:
        """The same with these rules in front."""
        return self.model_validate({**self.model_dump(), "allow": (*rules, *self.allow)})
