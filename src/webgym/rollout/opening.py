"""Opens browser sessions; a server that is away, or starts no browser, for a moment is waited for."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

from webgym.core.errors import BrowserError, NoCapacity, ServerError, Unauthorized, WebGymError
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

    Raises:
        WebGymError: the last failure, if no session could be opened in time.
    """
    since, pause, has_failed = time.monotonic(), config.server_retry_seconds, False
    while True:
        try:
            session = await client.open(options)
        except WebGymError as error:
            if not _may_pass(error):
                raise
            if isinstance(error, NoCapacity):
                since = max(since, held())
            elif not has_failed:
                since = (
                    time.monotonic()
                )  # a try that is not answered may itself take longer than the patience
            has_failed = True
            if time.monotonic() + pause > since + config.server_patience_seconds:
                raise
            tell(error.message)
            await asyncio.sleep(pause)
            pause = min(pause * 2, 8 * config.server_retry_seconds)
        else:
            tell("")
            return session


def _may_pass(error: WebGymError) -> bool:
    """Whether it is a failure of the server or a browser: an error of unknown type is one of the server's."""
    is_theirs = isinstance(error, ServerError | BrowserError) or type(error) is WebGymError
    return is_theirs and not isinstance(error, Unauthorized)
