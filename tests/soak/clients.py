"""Clients that use browsers as agents do, on calm and on hostile pages."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from random import Random
from typing import TypeVar

from tests.hostile import PAGES
from tests.soak.counts import Counts
from tests.soak.target import SoakPlan

from webgym.browser.document import ReadRequest
from webgym.core.action import BrowserAction, GoBack, LeftClick, Navigate, Scroll, Target, Type, Wait
from webgym.core.observation import Notice
from webgym.server.client import BrowserClient, Session
from webgym.server.messages import SessionOptions

T = TypeVar("T")

_HOSTILE = (*sorted(PAGES), "/dom/endless")
_MOST_STEPS = 12
_THINK_SECONDS = 0.6
_REFUSED_SECONDS = 0.3
"""Pause after a refused session: a gateway that is down refuses at once."""
_TTL_SECONDS = 10.0


class Agent:
    """Opens sessions one after the other, and makes random steps in each.

    Args:
        plan: of the soak.
        counts: to update.
        client: of the server.
        site: base URL of the hostile pages; all other paths are calm pages.
        seed: of the random choices.
    """

    def __init__(self, plan: SoakPlan, counts: Counts, client: BrowserClient, site: str, seed: str) -> None:
        self._plan = plan
        self._counts = counts
        self._client = client
        self._site = site
        self._random = Random(seed)

    async def run(self, over: asyncio.Event) -> None:
        """Run until ``over`` is set; a session that is open then is closed."""
        while not over.is_set():
            options = SessionOptions(
                mode=self._random.choice(("coordinates", "marks")),
                text=self._random.random() < 0.3,
                jpeg_quality=self._random.choice((None, None, 80)),
                ttl_seconds=_TTL_SECONDS,
            )
            try:
                session = await self._timed("open", self._client.open(options))
            except Exception as error:  # errors are counted by type
                self._counts.count_refused(error)
                await asyncio.sleep(_REFUSED_SECONDS)
                continue
            self._counts.opened += 1
            await self._episode(session, over)

    async def _episode(self, session: Session, over: asyncio.Event) -> None:
        try:
            for _ in range(self._random.randint(1, _MOST_STEPS)):
                await self._step(session)
                self._counts.steps += 1
                if over.is_set():
                    break
                await asyncio.sleep(self._random.uniform(0, _THINK_SECONDS))
            await self._timed("heartbeat", session.heartbeat())  # fails if the session was lost meanwhile
        except Exception as error:
            self._counts.count_lost(error)
        else:
            self._counts.closed += 1
        finally:
            await session.close()

    async def _step(self, session: Session) -> None:
        pick = self._random.random()
        if pick < 0.05:
            await self._timed("screenshot", session.screenshot())
        elif pick < 0.10:
            await self._timed("metadata", session.metadata())
        elif pick < 0.13:
            await self._timed("read", session.read(ReadRequest()))
        else:
            action = self._action()
            view = await self._timed(f"step {action}"[:200], session.step(action))
            self._count_notices(view.observation.notices)

    def _count_notices(self, notices: tuple[Notice, ...]) -> None:
        self._counts.notices += Counter(notice.kind for notice in notices)

    def _action(self) -> BrowserAction | None:
        where = Target(coordinate=(self._random.randint(0, 1000), self._random.randint(0, 1000)))
        choices: list[Callable[[], BrowserAction | None]] = [
            self._page,
            self._page,
            self._page,
            lambda: LeftClick(where),
            lambda: LeftClick(where),
            lambda: Type(where, "a text"),
            lambda: Scroll(self._random.choice(("up", "down"))),
            lambda: Wait(self._random.uniform(0, 1)),
            GoBack,
            lambda: None,
        ]
        return self._random.choice(choices)()

    def _page(self) -> Navigate:
        path = f"/calm/{self._random.randint(0, 99)}"
        if self._random.random() < self._plan.hostile:
            path = self._random.choice(_HOSTILE)
        self._counts.pages[path.split("/")[1]] += 1
        return Navigate(self._site + path)

    async def _timed(self, name: str, call: Awaitable[T]) -> T:
        clock = asyncio.get_running_loop().time
        began = clock()
        try:
            return await call
        finally:
            self._counts.count_time(clock() - began, name)
