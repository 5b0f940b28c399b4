"""The workers of a page, dedicated and shared ones: what they load, and whether they compute.

A worker is a target with a session of its own: the page's session does not report what it loads, nor when the
script of a shared one has come. Whether it computes is found out by evaluating a trivial expression, which it
answers once it is idle. Pages without workers cost nothing.
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
"""Parameters of ``Target.setAutoAttach`` in a page's session, which is told of dedicated workers only."""


_PROBE_SECONDS = 3600.0
"""Until a worker that does not answer is asked again. One that blocks its thread for ever is awaited once."""


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
        session.on("Target.attachedToTarget", AttachedToTarget, self.adopt)
        session.on("Target.detachedFromTarget", DetachedFromTarget, self.forget)

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
        self._traffic.begin(key, self._config.minor_seconds, name="a worker that computes")
        try:
            with contextlib.suppress(BrowserError):
                await session.do("Runtime.evaluate", {"expression": "0"}, seconds=_PROBE_SECONDS)
        finally:
            self._probes.pop(session.id, None)
            self._traffic.end(key)

    async def close(self) -> None:
        """Cancel the checks."""
        for task in tuple(self._probes.values()):
            task.cancel()
        await asyncio.gather(*self._probes.values(), return_exceptions=True)

    def adopt(self, attached: AttachedToTarget) -> None:
        """Handle a new worker, which is attached to and does not run yet."""
        session = Session(self._session.connection, attached.session_id)
        self._sessions[session.id] = session
        self._traffic.follow(session)
        session.send("Network.enable", {"maxTotalBufferSize": 0, "maxResourceBufferSize": 0})
        session.send("Runtime.runIfWaitingForDebugger")

    def forget(self, detached: DetachedFromTarget) -> None:
        """Handle that a worker is gone."""
        session = self._sessions.pop(detached.session_id, None)
        if session is not None:
            self._traffic.end(detached.target_id)  # the request for its script
            session.connection.drop_session(session.id, BrowserError("the worker ended"))
