"""One browser slot: a browser process group that serves one episode after the other.

Every episode gets a fresh browser context with one page, created in advance and disposed of at its end.
The browser itself is kept, and replaced after a number of episodes, at an age, or when it has crashed.
Between calls its processes are stopped (:meth:`Slot.awake`): an idle page uses no CPU.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import TypeVar

import msgspec

from webgym.browser import desktop, storage
from webgym.browser.actions import has_redirected
from webgym.browser.cdp import CommandFailed, Connection, Session, TargetGone
from webgym.browser.cdp_messages import (
    AttachedToTarget,
    BrowserContext,
    CreatedTarget,
    DetachedFromTarget,
    EmptyReply,
)
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.document import Document, ReadRequest, read
from webgym.browser.egress.proxy import Egress, ProxyListener
from webgym.browser.gestures import AnyAction, attempt
from webgym.browser.observe import (
    EarlyScreenshot,
    EffectCheck,
    Look,
    Metadata,
    capture,
    look,
    read_content,
)
from webgym.browser.page import BLANK, Page
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.browser.remote import SANDBOX, RemoteBrowser, connect
from webgym.browser.sandbox import SandboxState
from webgym.browser.settle import settle_timed
from webgym.browser.timers import Timers
from webgym.browser.traffic import introduce
from webgym.browser.upload import write_files
from webgym.browser.windows import Windows
from webgym.core.action import AnswerDialog, GoBack, Navigate
from webgym.core.errors import BrowserCrashed, BrowserError, BrowserOutOfMemory, BrowserTimeout
from webgym.core.identity import origin_of
from webgym.core.observation import Probed
from webgym.core.storage import StorageState

T = TypeVar("T")

_ATTACHED = [
    {"type": "page", "exclude": False},
    {"type": "shared_worker", "exclude": False},
    {"type": "service_worker", "exclude": False},
    {"exclude": True},
]

RECYCLE_SECONDS = 3600.0
"""Age at which a browser is replaced at the end of an episode."""

RECYCLE_BYTES = 400 * 1024**2
"""Memory use, without renderers, at which a browser is replaced at the end of an episode. A fresh one has 80
MB."""

CLOSE_SECONDS = 5.0
"""Disposing of a context. If a page hangs for longer, the slot's browser is replaced."""


class Slot:
    """One browser in which one episode at a time can run.

    Not safe for concurrent calls.

    Args:
        config: the limits.
        executable: the Chromium to run.
        profiles: where its profiles are created.
        egress: the proxy for all of its browser's connections.
        sandbox: the state of the sandbox in another slot; ``None`` if it is not known.
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
        self.executable = executable
        self._profiles = profiles
        self._egress = egress
        self._identity = config.identity
        self._listener: ProxyListener | None = None
        self._process: BrowserProcess | RemoteBrowser | None = None
        self._context = ""
        self._windows: Windows | None = None
        self._is_open = False
        self._was_revived = False
        """Whether the page was reloaded after a crash since the last action; that is done only once."""
        self._frozen_at: float | None = None
        self._timers: Timers | None = None
        self._attached: asyncio.Future[AttachedToTarget] | None = None
        self._episodes = 0
        self._last: Look | None = None
        """The episode's last look."""
        self._shown: Page | None = None
        """The page that it shows."""
        self._milliseconds: dict[str, float] = {}
        self._settled = ""

    # --- the browser --------------------------------------------------------------------------------

    @property
    def is_up(self) -> bool:
        """Whether its browser is running."""
        return self._process is not None and self._process.is_alive

    @property
    def is_open(self) -> bool:
        """Whether an episode is open."""
        return self._is_open

    @property
    def is_warm(self) -> bool:
        """Whether a fresh page is ready for the next episode."""
        return self._windows is not None and not self._is_open

    @property
    def page(self) -> Page:
        """The page in front of the open episode, for measurements.

        Raises:
            BrowserError: no episode is open.
            BrowserCrashed: the browser or the page is gone.
        """
        return self._living_windows().front

    @property
    def process(self) -> BrowserProcess | None:
        """The browser, for measurements; ``None`` also for a remote one."""
        return self._process if isinstance(self._process, BrowserProcess) else None

    @property
    def version(self) -> str:
        """Product and version of the browser; empty if it is not running."""
        return self._process.version if self._process is not None else ""

    @property
    def needs_replacement(self) -> bool:
        """Whether the browser is gone, or has reached a limit at which it is recycled."""
        process = self._process
        if process is None or not process.is_alive:
            return True
        return (
            self._episodes >= self.config.recycle_episodes
            or process.age >= RECYCLE_SECONDS
            or process.standing_bytes >= RECYCLE_BYTES
        )

    @contextlib.contextmanager
    def awake(self) -> Iterator[None]:
        """Let the slot's processes run during the block; they are stopped after it.

        For servers with many slots: once such a block was left, other methods must be called inside of one.
        With ``freeze`` off it does nothing.
        """
        self._thaw()
        try:
            yield
        finally:
            if self.config.freeze:
                self._freeze()

    @contextlib.contextmanager
    def asleep(self) -> Iterator[None]:
        """Inside a block of :meth:`awake`: stop the processes during this block. With ``freeze`` off it does
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
        if self.is_up and isinstance(self._process, BrowserProcess):
            self._process.freeze()
            self._frozen_at = asyncio.get_running_loop().time()

    def _thaw(self) -> None:
        frozen_at, self._frozen_at = self._frozen_at, None
        if frozen_at is None or not isinstance(self._process, BrowserProcess):
            return
        for page in self._windows.pages if self._windows is not None else ():
            page.traffic.pass_over(asyncio.get_running_loop().time() - frozen_at)
        self._process.thaw()

    async def start(self) -> None:
        """Start a browser, or connect to the remote one, replacing a running one.

        Raises:
            BrowserLaunchFailed: it does not start.
        """
        await self.stop()
        self._listener = await self._egress.open_listener()
        try:
            config = self.config.model_copy(update={"identity": self._identity})
            if config.remote is not None:
                self._process, self.sandbox = await connect(config), SANDBOX
            else:
                self._process, self.sandbox = await launch_sandboxed(
                    config, self.executable, self._profiles, self.sandbox, self._listener
                )
        except BaseException:
            await self.stop()
            raise
        self.launches += 1
        self._episodes = 0
        connection = self._process.connection
        self._timers = Timers(connection, is_shared=self._is_remote)
        if (
            self._context and self._is_remote
        ):  # if the last connection was lost without the browser's noticing
            connection.send("Target.disposeBrowserContext", {"browserContextId": self._context})
            self._context = ""
        connection.on("Target.attachedToTarget", AttachedToTarget, self._on_attached)
        connection.on("Target.detachedFromTarget", DetachedFromTarget, self._on_detached)
        # A remote browser would make windows of others wait for us, for ever if it does not notice our end.
        waits = not self._is_remote
        attach = {"autoAttach": True, "waitForDebuggerOnStart": waits, "flatten": True, "filter": _ATTACHED}
        try:
            await connection.call(
                "Target.setAutoAttach", attach, reply=EmptyReply, seconds=self.config.launch_seconds
            )
        except BaseException:
            await self.stop()
            raise

    async def stop(self) -> None:
        """End the browser and everything in it. Safe to call twice."""
        self._thaw()  # a stopped process does not answer
        process, self._process = self._process, None
        windows, self._windows = self._windows, None
        self._is_open = False
        if windows is not None:
            await windows.close()
        if process is not None:
            await process.kill()
        listener, self._listener = self._listener, None
        if listener is not None:
            await listener.close()

    @property
    def _is_remote(self) -> bool:
        return isinstance(self._process, RemoteBrowser)

    def _on_attached(self, attached: AttachedToTarget) -> None:
        windows, target, expected = self._windows, attached.target_info, self._attached
        if self._process is not None and self._is_remote and target.browser_context_id != self._context:
            # Somebody else's.
            self._process.connection.send("Target.detachFromTarget", {"sessionId": attached.session_id})
        elif target.type == "shared_worker":
            if windows is not None:
                windows.front.workers.adopt(attached)
        elif target.type == "service_worker":
            if self._process is not None:
                introduce(Session(self._process.connection, attached.session_id), self._process.told)
        elif expected is not None and not expected.done() and not target.opener_id:
            expected.set_result(attached)
        elif windows is not None and target.browser_context_id == self._context:
            windows.adopt(attached)  # perhaps without an opener: a click with Ctrl opens a new tab

    def _on_detached(self, detached: DetachedFromTarget) -> None:
        if self._windows is not None:
            self._windows.forget(detached)

    # --- an episode ---------------------------------------------------------------------------------

    async def warm(self) -> None:
        """Create a fresh page, so that the next episode begins at once. A running browser is kept.

        Raises:
            BrowserCrashed, BrowserTimeout, BrowserLaunchFailed: no page could be created.
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
                self._windows = Windows(await self._new_page(self._process))
        except TimeoutError:
            raise BrowserTimeout(f"no fresh page within {self.config.open_seconds:g} s") from None
        except (CommandFailed, TargetGone) as error:
            raise BrowserCrashed(f"no fresh page could be had: {error.message}") from error

    async def open(self, options: PageOptions) -> None:
        """Start an episode: a fresh context with a blank page.

        Args:
            options: options of the episode's page.

        Raises:
            BrowserError: the task's files cannot be written.
            BrowserCrashed, BrowserTimeout, BrowserLaunchFailed: no page could be created.
        """
        if self._is_open:
            await self.close()
        identity = self.config.identity.over(options.identity)
        if identity != self._identity:  # flags make it, so a browser has one identity
            await self.stop()
            self._identity = identity
        if not self.is_up or (self._windows is not None and self._windows.front.is_crashed):
            await self.stop()
        if self.needs_replacement:
            await self.start()
        await self.warm()
        assert self._windows is not None
        assert self._process is not None
        assert self._listener is not None
        self._listener.renew()
        for params in desktop.permissions(self._context, self._identity):
            self._process.connection.send("Browser.setPermission", params)
        page = self._windows.front
        try:
            await page.begin(options)
            if options.storage != StorageState():
                async with self._tab_beside() as tab:
                    await storage.put(tab, options.storage, self.config.open_seconds)
                page.origins.update(origin_of(one.origin) for one in options.storage.origins)
            if options.files:
                if not isinstance(self._process, BrowserProcess):
                    raise BrowserError("the task has files, which cannot be uploaded into a remote browser")
                page.files = await write_files(options.files, self._process.profile / "files")
        except OSError as error:
            raise BrowserError(f"the task's files cannot be written: {error.strerror}") from error
        except (CommandFailed, TargetGone) as error:
            raise BrowserCrashed(f"no fresh page could be had: {error.message}") from error
        self._is_open = True
        self._was_revived = False
        self._episodes += 1
        self._settled, self._last = "", None

    async def begin_again(self, options: PageOptions) -> None:
        """Start another episode in the open one's tab: without its cookies, history and notices.

        Cheaper than :meth:`open`, and only for websites that keep nothing but cookies in the browser: other
        storage and the browser's cache stay.

        Args:
            options: options of the episode's page.

        Raises:
            BrowserError: no episode is open.
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        if self.config.identity.over(options.identity) != self._identity:
            await self.open(options)
            return
        try:
            await self._living_windows().close_others().begin_again(options)
        except (CommandFailed, TargetGone) as error:
            raise BrowserCrashed(f"the tab could not be cleared: {error.message}") from error
        self._was_revived = False
        self._settled, self._last = "", None

    async def _new_page(self, process: BrowserProcess | RemoteBrowser) -> Page:
        connection, seconds = process.connection, self.config.open_seconds
        context = await connection.call(
            "Target.createBrowserContext", {"disposeOnDetach": True}, reply=BrowserContext, seconds=seconds
        )
        self._context = context.browser_context_id
        refused = {"behavior": "deny", "browserContextId": self._context, "eventsEnabled": True}
        connection.send("Browser.setDownloadBehavior", refused)
        width, height = PageOptions().viewport
        attached = await self._new_tab(connection, width=width, height=height)
        session = Session(connection, attached.session_id)
        assert self._timers is not None
        assert self._listener is not None
        page = Page(
            session, attached.target_info.target_id, self.config, self._listener, self._timers, process.told
        )
        await page.prepare()
        page.timers.start()
        return page

    async def _new_tab(self, connection: Connection, **size: int) -> AttachedToTarget:
        """A new tab of the episode's context, which waits for the debugger; the first has a size."""
        self._attached = asyncio.get_running_loop().create_future()
        target = {"url": BLANK, "browserContextId": self._context, **size}
        await connection.call(
            "Target.createTarget", target, reply=CreatedTarget, seconds=self.config.open_seconds
        )
        return await self._attached

    @contextlib.asynccontextmanager
    async def _tab_beside(self) -> AsyncIterator[Session]:
        """Another tab of the episode's context during the block, of which the episode knows nothing."""
        connection = self._living_process().connection
        attached = await self._new_tab(connection)
        session = Session(connection, attached.session_id)
        try:
            session.send("Runtime.runIfWaitingForDebugger")
            yield session
        finally:
            closing = {"targetId": attached.target_info.target_id}
            await connection.call(
                "Target.closeTarget", closing, reply=EmptyReply, seconds=self.config.open_seconds
            )
            connection.drop_session(session.id, TargetGone("the tab was closed"))

    async def storage(self) -> StorageState:
        """What the websites of the episode keep in the browser now.

        Raises:
            BrowserError: no episode is open, or it cannot be read.
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        origins = self._living_windows().front.origins
        async with self._tab_beside() as tab:
            return await storage.take(tab, self._context, origins, self.config.open_seconds)

    async def close(self) -> None:
        """End the episode: the context is disposed of with all its state. Safe to call twice.

        If that fails, the browser is ended; the next episode starts another.
        """
        self._thaw()
        windows, self._windows = self._windows, None
        self._is_open = False
        if windows is None:
            return
        await windows.close()
        if self._process is None or not self._process.is_alive:
            return
        try:
            await windows.front.timers.stop()
            await self._process.connection.call(
                "Target.disposeBrowserContext",
                {"browserContextId": self._context},
                reply=EmptyReply,
                seconds=CLOSE_SECONDS,
            )
        except (BrowserTimeout, BrowserCrashed, CommandFailed):
            await self.stop()

    # --- one step -----------------------------------------------------------------------------------

    async def act(self, action: AnyAction) -> None:
        """Carry out an action and wait until the page is quiet. A failure of the action becomes a notice.

        Raises:
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        await self._act(action)

    async def _act(self, action: AnyAction, early: EarlyScreenshot | None = None) -> None:
        windows = self._living_windows()
        self._milliseconds = {}
        self._was_revived = False
        windows.begin_action()
        async with windows.front.dialogs.interrupting():
            if isinstance(action, AnswerDialog) or await self._accept_dialog(windows.front):
                await self._carry_out(windows.front, action, early)
            await self._front()

    async def _accept_dialog(self, page: Page) -> bool:
        """Accept a dialog that is open, and wait until the page is quiet.

        Returns:
            Whether this page is the one that was last shown, which the action is meant for.
        """
        if not page.dialogs.is_open:
            return True
        with page.dialogs.accepting():
            await self._settle(page)
        page.next_is_typed = False
        if page is not self._shown:
            page.note("action_failed", "another window is in front, which was not shown yet")
        return page is self._shown

    async def _settle(self, page: Page) -> None:
        """Wait until a page is quiet; one that has crashed is loaded again."""
        try:
            self._settled = await settle_timed(page, self._milliseconds)
        except TargetGone:
            await self._reload_crashed(page)

    async def _carry_out(self, page: Page, action: AnyAction, early: EarlyScreenshot | None) -> None:
        operation = "navigate" if isinstance(action, Navigate) else "execute"
        start = time.perf_counter()
        try:
            if page.is_crashed and not page.is_gone:
                await self._reload_crashed(page)
            trace = EffectCheck(page, action)
            await trace.begin()
            await attempt(page, action)
            self._milliseconds[operation] = (time.perf_counter() - start) * 1000
            if early is not None:
                await early.begin()
            wanted = early.wanted if early is not None else None
            self._settled = await settle_timed(page, self._milliseconds, wanted)
            if isinstance(action, GoBack):
                await self._skip_redirects(page, action)
                page.tell_reloaded()
            await trace.end()
            if early is not None:
                await early.end(self._settled)
        except TargetGone:
            await self._reload_crashed(page)

    async def _front(self) -> Page:
        """The page in front, after waiting for one that has just come there until it is quiet."""
        while self._living_windows().update():
            page = self._living_windows().front
            if self._is_remote:
                await page.catch_up()
            await self._settle(page)
        return self._living_windows().front

    async def _skip_redirects(self, page: Page, action: GoBack) -> None:
        """Go further back if the page that the action went back to redirects by script.

        A page that was not left, but adds itself to the history again, may have shown something else. It is
        skipped the next time.
        """
        for _ in range(self.config.passed_over):
            if not await has_redirected(page):
                return
            if page.keeps_back():
                page.note(
                    "action_failed",
                    "the page has put itself in front of the earlier one again; go_back leaves it",
                )
                return
            await attempt(page, action)
            self._settled = await settle_timed(page, self._milliseconds)

    async def _reload_crashed(self, page: Page) -> None:
        process = self._living_process()
        if page.is_gone:
            return  # another one is in front then
        why, process.relieved = process.relieved, ""
        if not self._was_revived and page.can_reload:
            self._was_revived = True
            with contextlib.suppress(TargetGone):
                await page.revive(why)
                self._settled = await settle_timed(page, self._milliseconds)
                return
            why, process.relieved = process.relieved, ""
        if page.is_window:
            page.give_up_window(why)
            self._was_revived = False  # what lies behind it has most likely crashed with it
            return
        if not page.is_chosen:
            raise _crashed_again(why)
        try:  # the agent chose this page, and goes on without it
            await page.give_up(why)
            self._settled = await settle_timed(page, self._milliseconds)
        except TargetGone as error:
            raise _crashed_again(process.relieved) from error

    async def observe(self) -> Look:
        """Observe the page, without an action and without waiting.

        Raises:
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        return await self._observe(None)

    async def _observe(self, early: EarlyScreenshot | None) -> Look:
        async def query(page: Page) -> Look:
            milliseconds, self._milliseconds, self._shown = self._milliseconds, {}, page
            taken = early.result if early and page is early.page else None
            return await look(page, self._settled, milliseconds, taken)

        dialogs, seen = self.page.dialogs, None
        try:
            async with dialogs.interrupting():
                seen = self._last = await self._query(query)
                dialogs.stay_open = self.page.options.keep_dialogs
            return seen if seen is not None else self._last_look()
        except CommandFailed as error:
            raise BrowserCrashed(f"the page could not be looked at: {error.message}") from error

    def _last_look(self) -> Look:
        """The last look again, with what has happened since: while a dialog is open, pages show nothing."""
        assert self._last is not None, "dialogs stay open from the first look on"
        page, milliseconds = self.page, self._milliseconds
        self._milliseconds = {}
        observation = msgspec.structs.replace(
            self._last.observation,
            settled="dialog",
            notices=page.notices.take(),
            faults=page.take_faults(),
            milliseconds=milliseconds,
        )
        return Look(observation, self._last.image)

    async def _query(self, query: Callable[[Page], Awaitable[T]]) -> T:
        """Query the page in front; if it has crashed, reload it first."""
        while True:
            page = await self._front()
            try:
                result = await query(page)
            except TargetGone:
                await self._reload_crashed(page)
            else:
                self._was_revived = False
                return result

    async def step(
        self, action: AnyAction | None = None, *, between: Callable[[], Awaitable[None]] | None = None
    ) -> Look:
        """Carry out an action, and observe the page.

        Args:
            action: the action; ``None`` only observes.
            between: awaited between the two; it may freeze the slot. It is not called if the screenshot was
                taken while the page was settling.

        Raises:
            BrowserCrashed, BrowserTimeout: the browser is gone, or no longer answers.
        """
        if action is None:
            return await self.observe()
        early = EarlyScreenshot(self._living_windows().front)
        try:
            await self._act(action, early)
            if early.result is None:
                await early.drop()
                if between is not None:
                    await between()
            return await self._observe(early)
        finally:
            await early.drop()

    async def screenshot(self) -> bytes:
        """A screenshot without marks and without waiting."""
        try:
            return await self._query(lambda page: capture(page, page.options.jpeg_quality))
        except CommandFailed as error:
            raise BrowserCrashed(f"no screenshot could be taken: {error.message}") from error

    async def metadata(self) -> Metadata:
        """The page's state, without a screenshot."""
        try:
            content = await self._query(read_content)
        except CommandFailed as error:
            raise BrowserCrashed(f"the page could not be queried: {error.message}") from error
        page = self.page
        return Metadata(
            page.address,
            content.title,
            page.options.viewport,
            page.status,
            content.scroll,
            self._settled,
            (*page.notices.happened, *content.notices(page)),
        )

    async def probe(self, url: str) -> Probed:
        """Ask for a page from outside the browser, to see whether its website is there.

        Raises:
            BrowserCrashed: the browser is gone.
        """
        if self._listener is None:
            raise BrowserCrashed("the browser process ended")
        return await self._listener.probe(url, self.config.navigate_seconds)

    async def read(self, request: ReadRequest) -> Document:
        """Read the whole document, in view or not."""
        try:
            return await read(self.page, request)
        except (TargetGone, CommandFailed) as error:
            raise BrowserCrashed(f"the page could not be read: {error.message}") from error

    def _living_windows(self) -> Windows:
        if self._windows is None or not self._is_open:
            raise BrowserError("no episode is open in this slot")
        self._living_process()
        if all(page.is_gone for page in self._windows.pages):
            raise BrowserCrashed("the page closed itself")
        return self._windows

    def _living_process(self) -> BrowserProcess | RemoteBrowser:
        if self._process is not None and self._process.is_alive:
            return self._process
        lost = self._process.connection.lost if self._process is not None else None
        raise lost or BrowserCrashed("the browser process ended")


def _crashed_again(why: str) -> BrowserCrashed:
    what = "the page crashed again"
    return BrowserOutOfMemory(f"{what}: {why}") if why else BrowserCrashed(what)
