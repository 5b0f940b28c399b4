"""One browser slot: a browser process group that serves one episode after the other.

Every episode gets a fresh browser context with one page, made ahead of it and thrown away at its end.
The browser itself is kept, and replaced after a number of episodes, at an age, or when it has crashed.
Between calls its processes are stopped (:meth:`Slot.awake`): an idle page uses no CPU.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import TypeVar

from webgym.browser.actions import is_led_on
from webgym.browser.cdp import CommandFailed, Session, TargetGone
from webgym.browser.cdp_messages import (
    AttachedToTarget,
    BrowserContext,
    CreatedTarget,
    DetachedFromTarget,
    EmptyReply,
)
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.document import Document, ReadRequest, read
from webgym.browser.early_screenshot import EarlyScreenshot
from webgym.browser.effect import EffectCheck
from webgym.browser.egress.proxy import Egress, ProxyListener
from webgym.browser.gestures import AnyAction, attempt
from webgym.browser.observe import Look, Metadata, ask, capture, look
from webgym.browser.page import Page
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.browser.sandbox import SandboxState
from webgym.browser.settle import settle_timed
from webgym.browser.timers import Timers
from webgym.browser.upload import lay_out
from webgym.core.action import GoBack, Navigate
from webgym.core.errors import (
    BrowserCrashed,
    BrowserError,
    BrowserOutOfMemory,
    BrowserTimeout,
)

T = TypeVar("T")

_PAGES_ONLY = [{"type": "page", "exclude": False}, {"exclude": True}]


class Slot:
    """One place where an episode can run.

    Not safe for concurrent calls: whoever holds the slot makes one call at a time.

    Args:
        config: the limits.
        executable: the Chromium to run.
        profiles: where its profiles live.
        egress: the proxy that its browser reaches the network through.
        sandbox: what another slot's launch found out about the sandbox; ``None`` if nothing is known.
    """

    def __init__(
        self,
        config: BrowserConfig,
        executable: Path,
        profiles: ProfileRoot,
        egress: Egress,
        sandbox: SandboxState | None = None,
    ) -> None:
        self.config = config
        self.sandbox = sandbox
        self.launches = 0
        self._executable = executable
        self._profiles = profiles
        self._egress = egress
        self._listener: ProxyListener | None = None
        self._process: BrowserProcess | None = None
        self._context = ""
        self._page: Page | None = None
        self._is_open = False
        self._was_revived = False
        """Whether the page was brought back since the last action: twice would be in vain."""
        self._frozen_at: float | None = None
        self._timers: Timers | None = None
        self._attached: asyncio.Future[AttachedToTarget] | None = None
        self._episodes = 0
        self._milliseconds: dict[str, float] = {}
        self._settled = ""

    # --- the browser --------------------------------------------------------------------------------

    @property
    def is_up(self) -> bool:
        """Whether its browser runs."""
        return self._process is not None and self._process.is_alive

    @property
    def is_open(self) -> bool:
        """Whether an episode is on."""
        return self._is_open

    @property
    def is_warm(self) -> bool:
        """Whether a fresh page waits for an episode."""
        return self._page is not None and not self._is_open

    @property
    def page(self) -> Page:
        """The open episode's page, for measurements.

        Raises:
            BrowserCrashed, BrowserError: there is none.
        """
        return self._living_page()

    @property
    def process(self) -> BrowserProcess | None:
        """The browser, for measurements."""
        return self._process

    @property
    def needs_replacement(self) -> bool:
        """Whether the browser is gone, or has served as long as it may."""
        process = self._process
        if process is None or not process.is_alive:
            return True
        return (
            self._episodes >= self.config.recycle_episodes
            or process.age >= self.config.recycle_seconds
            or process.standing_bytes >= self.config.recycle_bytes
        )

    @contextlib.contextmanager
    def awake(self) -> Iterator[None]:
        """Let the slot's processes run for the block; they are stopped after it.

        For whoever holds many slots: every other method may be called outside of it only if no such block
        was left before. With ``freeze`` off it does nothing.
        """
        self._thaw()
        try:
            yield
        finally:
            if self.config.freeze:
                self._freeze()

    @contextlib.contextmanager
    def asleep(self) -> Iterator[None]:
        """Within a block of :meth:`awake`: stop the processes for this one. With ``freeze`` off it does
        nothing."""
        if self.config.freeze:
            self._freeze()
        try:
            yield
        finally:
            self._thaw()

    @property
    def is_frozen(self) -> bool:
        """Whether its processes are stopped."""
        return self._frozen_at is not None

    def _freeze(self) -> None:
        if self.is_up and self._process is not None:
            self._process.freeze()
            self._frozen_at = asyncio.get_running_loop().time()

    def _thaw(self) -> None:
        frozen_at, self._frozen_at = self._frozen_at, None
        if frozen_at is None or self._process is None:
            return
        if self._page is not None:
            self._page.traffic.pass_over(asyncio.get_running_loop().time() - frozen_at)
        self._process.thaw()

    async def start(self) -> None:
        """Bring up a browser, a fresh one if there is one already.

        Raises:
            BrowserLaunchFailed: it does not come up.
        """
        await self.stop()
        self._listener = await self._egress.open_listener()
        try:
            self._process, self.sandbox = await launch_sandboxed(
                self.config, self._executable, self._profiles, self.sandbox, self._listener
            )
        except BaseException:
            await self.stop()
            raise
        self.launches += 1
        self._episodes = 0
        connection = self._process.connection
        self._timers = Timers(connection, self.config)
        connection.on("Target.attachedToTarget", AttachedToTarget, self._on_attached)
        connection.on("Target.detachedFromTarget", DetachedFromTarget, self._on_detached)
        attach = {"autoAttach": True, "waitForDebuggerOnStart": True, "flatten": True, "filter": _PAGES_ONLY}
        try:
            await connection.call(
                "Target.setAutoAttach", attach, reply=EmptyReply, seconds=self.config.launch_seconds
            )
        except BaseException:
            await self.stop()
            raise

    async def stop(self) -> None:
        """End the browser and everything in it. Safe to call twice."""
        self._thaw()  # who is stopped does not answer
        process, self._process = self._process, None
        page, self._page = self._page, None
        self._is_open = False
        if page is not None:
            await page.close()
        if process is not None:
            await process.kill()
        listener, self._listener = self._listener, None
        if listener is not None:
            await listener.close()

    def _on_attached(self, attached: AttachedToTarget) -> None:
        wanted = self._attached
        if wanted is not None and not wanted.done() and not attached.target_info.opener_id:
            wanted.set_result(attached)
        elif self._page is not None:  # also without an opener: Ctrl and a click open a tab of its own
            self._page.popups.adopt(attached)

    def _on_detached(self, detached: DetachedFromTarget) -> None:
        if self._page is None:
            return
        self._page.popups.forget(detached.target_id)
        if detached.session_id == self._page.session.id:
            self._page.is_gone = True
            self._page.session.connection.fail_session(
                detached.session_id, TargetGone("the page closed itself")
            )

    # --- an episode ---------------------------------------------------------------------------------

    async def warm(self) -> None:
        """Have a fresh page ready, so that the next episode begins at once. A browser that is there is kept.

        Raises:
            BrowserCrashed, BrowserTimeout, BrowserLaunchFailed: there is no page to be had.
        """
        if self.is_warm:
            return
        if self._is_open:
            await self.close()
        if not self.is_up:
            await self.start()
        assert self._process is not None
        try:
            async with asyncio.timeout(self.config.open_seconds):
                self._page = await self._new_page(self._process)
        except TimeoutError:
            raise BrowserTimeout(f"no fresh page within {self.config.open_seconds:g} s") from None
        except (CommandFailed, TargetGone) as error:
            raise BrowserCrashed(f"no fresh page could be had: {error.message}") from error

    async def open(self, options: PageOptions) -> None:
        """Start an episode: a fresh context with a blank page.

        Raises:
            BrowserCrashed, BrowserTimeout, BrowserLaunchFailed: there is no page to be had.
        """
        if self._is_open:
            await self.close()
        if not self.is_up or (self._page is not None and self._page.is_lost):
            await self.stop()
        if self.needs_replacement:
            await self.start()
        await self.warm()
        assert self._page is not None
        assert self._process is not None
        assert self._listener is not None
        self._listener.renew()
        try:
            await self._page.begin(options)
            if options.files:
                self._page.files = await lay_out(options.files, self._process.profile / "files")
        except OSError as error:
            raise BrowserError(f"the task's files cannot be written: {error.strerror}") from error
        except (CommandFailed, TargetGone) as error:
            raise BrowserCrashed(f"no fresh page could be had: {error.message}") from error
        self._is_open = True
        self._was_revived = False
        self._episodes += 1
        self._settled = ""

    async def _new_page(self, process: BrowserProcess) -> Page:
        connection, seconds = process.connection, self.config.open_seconds
        context = await connection.call(
            "Target.createBrowserContext", {"disposeOnDetach": True}, reply=BrowserContext, seconds=seconds
        )
        self._context = context.browser_context_id
        refused = {"behavior": "deny", "browserContextId": self._context, "eventsEnabled": True}
        self._attached = asyncio.get_running_loop().create_future()
        width, height = PageOptions().viewport
        target = {"url": "about:blank", "browserContextId": self._context, "width": width, "height": height}
        connection.send("Browser.setDownloadBehavior", refused)
        await connection.call("Target.createTarget", target, reply=CreatedTarget, seconds=seconds)
        attached = await self._attached
        session = Session(connection, attached.session_id)
        assert self._timers is not None
        page = Page(session, attached.target_info.target_id, self.config, self._egress, self._timers)
        await page.prepare()
        page.timers.start()
        return page

    async def close(self) -> None:
        """End the episode: the context and all its state are thrown away. Safe to call twice.

        A browser that does not let go of it is ended; the next episode brings up another.
        """
        self._thaw()
        page, self._page = self._page, None
        self._is_open = False
        if page is None:
            return
        await page.close()
        if self._process is None or not self._process.is_alive:
            return
        try:
            await page.timers.stop()
            await self._process.connection.call(
                "Target.disposeBrowserContext",
                {"browserContextId": self._context},
                reply=EmptyReply,
                seconds=self.config.close_seconds,
            )
        except (BrowserTimeout, BrowserCrashed, CommandFailed):
            await self.stop()

    # --- one step -----------------------------------------------------------------------------------

    async def act(self, action: AnyAction) -> None:
        """Carry an action out and wait until the page is quiet. What the page refuses is kept as a notice.

        Raises:
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        await self._act(self._living_page(), action)

    async def _act(self, page: Page, action: AnyAction, early: EarlyScreenshot | None = None) -> None:
        self._milliseconds = {}
        self._was_revived = False
        operation = "navigate" if isinstance(action, Navigate) else "execute"
        start = time.perf_counter()
        page.begin_action()
        try:
            if page.is_crashed:
                await self._bring_back(page)
            trace = EffectCheck(page, action)
            await trace.begin()
            await attempt(page, action)
            self._milliseconds[operation] = (time.perf_counter() - start) * 1000
            if early is not None:
                await early.begin()
            self._settled = await settle_timed(page, self._milliseconds)
            if isinstance(action, GoBack):
                await self._go_past(page, action)
            ending = [early.end(self._settled)] if early is not None else []
            await asyncio.gather(*ending, trace.end())  # asked at once, answered in this order
        except TargetGone:
            await self._bring_back(page)

    async def _go_past(self, page: Page, action: GoBack) -> None:
        """Go further back where the page that was gone back to leads on by itself."""
        for _ in range(self.config.passed_over):
            if not await is_led_on(page):
                return
            await attempt(page, action)
            self._settled = await settle_timed(page, self._milliseconds)

    async def _bring_back(self, page: Page) -> None:
        process = self._living_process()
        if page.is_gone:
            raise BrowserCrashed("the page closed itself")
        if self._was_revived:
            raise self._crashed("the page crashed again")
        self._was_revived = True
        why, process.relieved = process.relieved, ""
        try:
            await page.revive(why)
            self._settled = await settle_timed(page, self._milliseconds)
        except TargetGone as error:
            raise self._crashed("the page crashed again while it was loaded") from error

    def _crashed(self, what: str) -> BrowserCrashed:
        """The error for a page that cannot be brought back."""
        why = self._process.relieved if self._process is not None else ""
        return BrowserOutOfMemory(f"{what}: {why}") if why else BrowserCrashed(what)

    async def observe(self) -> Look:
        """Look at the page as it is.

        Raises:
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        return await self._observe(None)

    async def _observe(self, early: EarlyScreenshot | None) -> Look:
        page = self._living_page()
        milliseconds, self._milliseconds = self._milliseconds, {}
        try:
            return await self._look_at(
                page, lambda: look(page, self._settled, milliseconds, early.result if early else None)
            )
        except CommandFailed as error:
            raise BrowserCrashed(f"the page could not be looked at: {error.message}") from error

    async def _look_at(self, page: Page, ask: Callable[[], Awaitable[T]]) -> T:
        """Look at the page; one that has crashed is brought back first."""
        while True:
            try:
                seen = await ask()
            except TargetGone:
                await self._bring_back(page)
            else:
                self._was_revived = False
                return seen

    async def step(
        self, action: AnyAction | None = None, *, between: Callable[[], Awaitable[None]] | None = None
    ) -> Look:
        """Act, then look. What is awaited ``between`` the two may put the slot to sleep; it is left out
        where the picture was taken while the page was waited for."""
        if action is None:
            return await self.observe()
        page = self._living_page()
        early = EarlyScreenshot(page)
        try:
            await self._act(page, action, early)
            if early.result is None:
                await early.drop()
                if between is not None:
                    await between()
            return await self._observe(early)
        finally:
            await early.drop()

    async def screenshot(self) -> bytes:
        """The bare picture, without marks and without waiting."""
        page = self._living_page()
        try:
            return await self._look_at(page, lambda: capture(page))
        except CommandFailed as error:
            raise BrowserCrashed(f"no picture could be had: {error.message}") from error

    async def metadata(self) -> Metadata:
        """Where the page is, without a picture."""
        page = self._living_page()
        try:
            seen = await self._look_at(page, lambda: ask(page))
        except CommandFailed as error:
            raise BrowserCrashed(f"the page could not be asked: {error.message}") from error
        return Metadata(
            page.address,
            seen.title,
            page.options.viewport,
            page.status,
            seen.scroll,
            self._settled,
            (*page.happened, *seen.notices(page)),
        )

    async def read(self, request: ReadRequest) -> Document:
        """What the whole document holds."""
        try:
            return await read(self._living_page(), request)
        except (TargetGone, CommandFailed) as error:
            raise BrowserCrashed(f"the page could not be read: {error.message}") from error

    def _living_page(self) -> Page:
        if self._page is None or not self._is_open:
            raise BrowserError("no episode is open in this slot")
        self._living_process()
        if self._page.is_gone:
            raise BrowserCrashed("the page closed itself")
        return self._page

    def _living_process(self) -> BrowserProcess:
        if self._process is not None and self._process.is_alive:
            return self._process
        lost = self._process.connection.lost if self._process is not None else None
        raise lost or BrowserCrashed("the browser process ended")
