"""Opens browser sessions; a server or an offline web that is away, or a server that starts no browser, for a
moment is waited for."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable

from webgym.core.errors import BrowserError, NoCapacity, ServerError, SitesError, Unauthorized, WebGymError
from webgym.rollout.config import CollectorConfig
from webgym.rollout.driver import Browsers, BrowserSession
from webgym.server.messages import SessionOptions


async def open_patiently(
    client: Browsers,
    options: SessionOptions,
    config: CollectorConfig,
    *,
    tell: Callable[[str], None],
    held: Callable[[], float] = lambda: -math.inf,
    ready: Callable[[], Awaitable[object]] | None = None,
) -> BrowserSession:
    """A browser session. The client has reached the server before, so that whatever it answers may pass, but
    a token that it refuses.

    Args:
        client: opens it.
        options: of the session.
        config: how long to wait, and how often to ask.
        tell: called with the reason before each pause, and with an empty string at the end of the waiting.
        held: when the caller last held a session, on the monotonic clock. Waiting for a slot counts from then
            on.
        ready: called before each try; while the offline web does not answer it, that is waited for, too.

    Raises:
        WebGymError: the last failure, if no session could be opened in time.
    """
    since, pause, has_failed = time.monotonic(), config.server_retry_seconds, False
    while True:
        try:
            if ready is not None:
                await ready()
            session = await client.open(options)
        except WebGymError as error:
            may_pass = is_of_server(error) or isinstance(error, BrowserError | SitesError)
            if not may_pass or isinstance(error, Unauthorized):
                raise
            if isinstance(error, NoCapacity):
                since = max(since, held())
            elif not has_failed:  # a try without an answer may itself take longer than the patience
                since = time.monotonic()
            has_failed = True
            if time.monotonic() + pause > since + config.server_patience_seconds:
                raise
            tell(error.message)
            await asyncio.sleep(pause)
            pause = min(pause * 2, longest_pause(config))
        else:
            tell("")
            return session


def longest_pause(config: CollectorConfig) -> float:
    """The longest pause before a server is asked again, seconds."""
    return 8 * config.server_retry_seconds


def is_of_server(error: WebGymError) -> bool:
    """Whether the server failed: an error of unknown type is one of the server's."""
    return isinstance(error, ServerError) or type(error) is WebGymError
