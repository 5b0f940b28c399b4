"""The server under test: a gateway and its workers, as processes of their own that can be killed."""

from __future__ import annotations

import asyncio
from asyncio.subprocess import Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import msgspec
import psutil

from webgym.bench.apart import start_apart, stop_apart
from webgym.bench.soak.leaks import Census, leaked, take
from webgym.bench.soak.plan import SoakPlan
from webgym.server.messages import Watched
from webgym.server.operations import WATCH

_POLL_SECONDS = 0.1


class Target:
    """A running server, the same one before and after it is killed.

    Attributes:
        url: its address.
        token: of every call.
        opened_before: how many sessions had been opened when its present run began.
    """

    def __init__(self, plan: SoakPlan, root: Path, executable: Path | None, log: int) -> None:
        self._log = log
        self.plan = plan
        self.root = root
        self._config = plan.server(root, executable)
        self.url = ""
        self.token = ""
        self.opened_before = 0
        self._process: Process | None = None

    @property
    def pid(self) -> int:
        """Of the gateway."""
        assert self._process is not None
        return self._process.pid

    async def start(self) -> None:
        """Bring it up, at the address that it had before."""
        self._process, address = await start_apart(self._config, self.plan.fleet(), self._log)
        self.url, self.token = address.url, address.token
        port = int(self.url.rpartition(":")[2])
        self._config = self._config.model_copy(update={"port": port, "token": self.token})

    async def kill(self) -> None:
        """kill -9, and nothing else."""
        assert self._process is not None
        self._process.kill()
        await self._process.wait()

    async def stop(self) -> None:
        """Tell it to end."""
        assert self._process is not None
        await stop_apart(self._process)

    async def watched(self) -> Watched:
        """What it says about itself.

        Raises:
            httpx.HTTPError: it says nothing.
        """
        headers = {"authorization": f"Bearer {self.token}"}
        async with (
            httpx.AsyncClient(base_url=self.url, headers=headers, trust_env=False) as http,
            http.stream(WATCH.method, WATCH.path) as answer,
        ):
            return msgspec.json.decode(await anext(answer.aiter_lines()), type=Watched)

    async def at_rest(self) -> list[str]:
        """What is still in use."""
        try:
            now = await self.watched()
        except httpx.HTTPError as error:
            return [f"the server does not answer: {error!r}"]
        found = [f"a lease: {session}" for session in now.sessions]
        if now.slots.free != self.plan.slots or now.slots.total != self.plan.slots or now.slots.waiting:
            found.append(f"slots: {now.slots}")
        return found

    async def settled(self, before: Census | None, seconds: float) -> tuple[Census | None, list[str]]:
        """Wait until nothing is in use, and nothing is there that was not there before.

        Returns:
            What exists then, and what is too much of it after ``seconds``.
        """
        loop = asyncio.get_running_loop()
        deadline = loop.time() + seconds
        census = None
        while True:
            if not (found := await self.at_rest()):
                try:
                    census = await asyncio.to_thread(take, self.pid, self.root)
                except psutil.NoSuchProcess as error:  # it ended while we looked
                    found = [str(error)]
                else:
                    found = leaked(before, census, self.plan.slots) if before is not None else []
            if not found or loop.time() > deadline:
                return census, found
            await asyncio.sleep(_POLL_SECONDS)


@asynccontextmanager
async def running_target(
    plan: SoakPlan, root: Path, executable: Path | None, log: int
) -> AsyncIterator[Target]:
    """A server for the length of the block. ``log``: descriptor that its log goes to (or ``DEVNULL``)."""
    target = Target(plan, root, executable, log)
    await target.start()
    try:
        yield target
    finally:
        await target.stop()
