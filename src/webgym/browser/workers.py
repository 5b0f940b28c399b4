"""The dedicated workers of a page: what they load, and whether they compute.

A worker is a target with a session of its own: the page's session does not report what it loads. Whether it
computes is found out by evaluating a trivial expression, which it answers once it is idle. Pages without
workers cost nothing.
"""

from __future__ import annotations

import asyncio
import contextlib

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import AttachedToTarget, DetachedFromTarget
from webgym.browser.config import BrowserConfig
from webgym.browser.traffic import Traffic
from webgym.core.errors import BrowserError

AUTO_ATTACH = {
    "autoAttach": True,
    "waitForDebuggerOnStart": True,
    "flatten": True,
    "filter": [{"type": "worker", "exclude": False}, {"exclude": True}],
}
"""Parameters of ``Target.setAutoAttach`` in a page's session."""


class Workers:
    """The workers of one page. Attaches to each before it runs.

    Args:
        session: the page's session.
        traffic: records what the workers load.
        config: deadlines.
    """

    def __init__(self, session: Session, traffic: Traffic, config: BrowserConfig) -> None:
        self._session = session
        self._traffic = traffic
        self._config = config
        self._sessions: dict[str, Session] = {}
        self._probes: dict[str, asyncio.Task[None]] = {}
        session.on("Target.attachedToTarget", AttachedToTarget, self._on_attached)
        session.on("Target.detachedFromTarget", DetachedFromTarget, self._on_detached)

    def __len__(self) -> int:
        return len(self._sessions)

    def probe(self) -> None:
        """Check whether every worker is idle; the page's traffic waits for the answers."""
        for session_id, session in self._sessions.items():
            if session_id not in self._probes:
                task = asyncio.get_running_loop().create_task(self._probe(session))
                self._probes[session_id] = task

    async def _probe(self, session: Session) -> None:
        key = f"worker {session.id}"
        self._traffic.begin(key, self._config.minor_seconds, endpoint=key)
        try:
            # A worker that blocks its thread forever exceeds the limit, and is then ignored.
            with contextlib.suppress(BrowserError):
                await session.do("Runtime.evaluate", {"expression": "0"}, seconds=self._config.settle_seconds)
        finally:
            self._probes.pop(session.id, None)
            self._traffic.end(key)

    async def close(self) -> None:
        """Cancel the checks."""
        for task in tuple(self._probes.values()):
            task.cancel()
        await asyncio.gather(*self._probes.values(), return_exceptions=True)

    def _on_attached(self, attached: AttachedToTarget) -> None:
        session = Session(self._session.connection, attached.session_id)
        self._sessions[session.id] = session
        self._traffic.follow(session)
        session.send("Network.enable", {"maxTotalBufferSize": 0, "maxResourceBufferSize": 0})
        session.send("Runtime.runIfWaitingForDebugger")

    def _on_detached(self, detached: DetachedFromTarget) -> None:
        session = self._sessions.pop(detached.session_id, None)
        if session is not None:
            session.connection.drop_session(session.id, BrowserError("the worker ended"))
