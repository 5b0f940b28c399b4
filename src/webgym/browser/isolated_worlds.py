"""Our scripts in the page: an isolated world in the tab's own frame, and one in every frame of another
origin below it, which the first cannot look into.

All of a slot's frames share one renderer and one session. A frame of another origin is entered once per
document: the world above hands out its element, the protocol tells the frame's id, and a world of its own
is made there. Closed shadow roots, which no script can enter, are opened to our worlds the same way. A
page that has neither costs no round trip.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import Iterable
from importlib import resources
from typing import TypeVar

import msgspec

from webgym.browser.cdp import CommandFailed, Session
from webgym.browser.cdp_messages import (
    Described,
    Evaluated,
    FrameAttached,
    FrameEvent,
    FrameNavigated,
    Node,
    Properties,
    RemoteObject,
    Resolved,
    World,
)
from webgym.browser.config import BrowserConfig
from webgym.core.errors import BrowserError, BrowserTimeout

T = TypeVar("T")

_WORLD = "webgym"
_SAID_LENGTH = 300

_FILES = (
    "dom",
    "page",
    "settle",
    "geometry",
    "lists",
    "typing",
    "roles",
    "reach",
    "wheel",
    "pointer",
    "effect",
    "early",
    "sight",
    "targets",
    "observe",
    "marks",
    "document",
)
_SCRIPTS = resources.files("webgym.browser") / "scripts"
_LISTENERS = (_SCRIPTS / "listeners.js").read_text("utf-8").rstrip()
_SCRIPT = "".join((_SCRIPTS / f"{name}.js").read_text("utf-8") for name in _FILES)

_WORLD_IS_GONE = (
    "Cannot find context",
    "context was destroyed",
    "navigated or closed",
    "No frame for given id",
    "Could not find object",
    "does not belong to the document",
    "Internal error",  # our script was ended together with the page's own
)


class DocumentGone(BrowserError):
    """The page moved on to another document while a script ran in it."""

    code = "browser_document_gone"


class DocumentActivity(msgspec.Struct, frozen=True):
    """How often a document has changed, and how many milliseconds ago it did so last."""

    changes: int
    ago: float


class Worlds:
    """The worlds of one tab.

    Args:
        session: the tab's.
        main_frame: id of its main frame.
        config: the slot's limits.
    """

    def __init__(self, session: Session, main_frame: str, config: BrowserConfig) -> None:
        self.in_view: set[str] = set()
        """Frames of other origins that the last look found in the viewport."""
        self._session = session
        self._main = main_frame
        self._config = config
        self._limits = json.dumps(
            {
                "title": config.title_characters,
                "address": config.address_characters,
                "text": config.text_characters,
                "name": config.name_characters,
                "value": config.value_characters,
                "elements": config.observed_elements,
                "options": config.listed_options,
            }
        )
        self._question = f"webgym-{secrets.token_hex()}"
        """Type of the event by which the page's own world is asked what listens there."""
        self._worlds: dict[str, int] = {}
        """World by frame; they end with their documents."""
        self._parents: dict[str, str] = {}
        """The frame above, of every frame below the main one."""
        self._has_new_frames = False
        self._restless: set[int] = set()
        """Worlds of frames that are not waited for: they never stop changing."""
        session.on("Page.frameAttached", FrameAttached, self._on_attached)
        session.on("Page.frameNavigated", FrameNavigated, self._on_navigated)
        session.on("Page.frameDetached", FrameEvent, self._on_detached)

    @property
    def script_in_page(self) -> dict[str, object]:
        """Parameters of ``Page.addScriptToEvaluateOnNewDocument`` for what runs in the page's own world."""
        return {"source": f"{_LISTENERS}('{self._question}')", "includeCommandLineAPI": True}

    # --- calls --------------------------------------------------------------------------------------

    async def run(
        self, function: str, *arguments: object, reply: type[T], seconds: float, frame: str | None = None
    ) -> T:
        """Call ``webgym.<function>`` and wait for what it gives.

        Args:
            arguments: JSON values; :class:`msgspec.Raw` is JSON already.
            frame: whose world; ``None`` is the tab's own.

        Raises:
            DocumentGone: the frame moved on to another document meanwhile.
            BrowserTimeout: the page did not answer in time.
        """
        frame = frame or self._main
        written = ",".join(
            bytes(argument).decode() if isinstance(argument, msgspec.Raw) else json.dumps(argument)
            for argument in arguments
        )
        try:
            world = await self._enter(frame, seconds)
            value = await self._evaluate(f"webgym.{function}({written})", world, seconds)
        except CommandFailed as error:
            self._raise_if_gone(error, frame)
            raise
        return msgspec.json.decode(value.value, type=reply)

    @property
    def is_entered(self) -> bool:
        """Whether the tab's own frame is: several may ask it at once then, and it answers in their order."""
        return self._main in self._worlds

    def post(self, function: str) -> None:
        """Call ``webgym.<function>()`` in the tab's own frame before whatever comes next; do not wait."""
        world = self._worlds.get(self._main)
        if world is not None:
            self._session.send("Runtime.evaluate", {"expression": f"webgym.{function}()", "contextId": world})

    def forget(self) -> None:
        """The renderer is gone, and all worlds with it."""
        self._worlds.clear()
        self._parents.clear()
        self.in_view.clear()

    async def _enter(self, frame: str, seconds: float) -> int:
        if frame not in self._worlds:
            created = await self._session.call(
                "Page.createIsolatedWorld",
                {"frameId": frame, "worldName": _WORLD},
                reply=World,
                seconds=seconds,
            )
            begin = f"webgym.limits = {self._limits}; webgym.question = '{self._question}'; webgym.attach()"
            await self._evaluate(f"{_SCRIPT} {begin}", created.execution_context_id, seconds)
            self._worlds[frame] = created.execution_context_id
        return self._worlds[frame]

    async def _evaluate(
        self, expression: str, world: int, seconds: float, *, group: str = ""
    ) -> RemoteObject:
        """The result by value; in an object group, as a handle."""
        evaluated = await self._session.call(
            "Runtime.evaluate",
            {
                "expression": expression,
                "contextId": world,
                "returnByValue": not group,
                "awaitPromise": not group,
                "userGesture": False,
                "objectGroup": group,
            },
            reply=Evaluated,
            seconds=seconds,
        )
        if evaluated.exception_details is not None:
            thrown = evaluated.exception_details.exception
            said = thrown.description if thrown and thrown.description else evaluated.exception_details.text
            raise CommandFailed(f"a script of ours failed in the page: {said[:_SAID_LENGTH]}")
        return evaluated.result

    def _raise_if_gone(self, error: CommandFailed, frame: str) -> None:
        if any(words in error.message for words in _WORLD_IS_GONE):
            self._worlds.pop(frame, None)
            raise DocumentGone(error.message) from error

    # --- what has to be entered ---------------------------------------------------------------------

    @property
    def has_new_frames(self) -> bool:
        """Whether a frame came or moved on since :meth:`explore`."""
        return self._has_new_frames

    async def explore(self, *, again: bool = False) -> None:
        """Enter what came to the page since the last call: frames of other origins, and closed roots.

        Args:
            again: look for frames although none came or moved on.

        Raises:
            DocumentGone: the tab moved on meanwhile.
            BrowserTimeout: the page did not answer in time.
        """
        with_frames = self._has_new_frames or again
        self._has_new_frames = False
        await self._explore(self._main, with_frames)

    async def _explore(self, frame: str, with_frames: bool) -> None:
        """Ask one world what it cannot enter, enter that, and go on in what was entered."""
        below = {known for known in self._worlds if self._parents.get(known) == frame}
        try:
            below |= await self._learn(frame, with_frames)
        except CommandFailed as error:
            self._raise_if_gone(error, frame)
            raise
        finally:
            self._session.send("Runtime.releaseObjectGroup", {"objectGroup": frame})
        for one in await asyncio.gather(*(self._explore_below(child) for child in below)):
            if one is not None:
                raise one

    async def _explore_below(self, frame: str) -> BrowserTimeout | None:
        """A frame that goes away, or that nobody can enter, is left out; one that hangs hangs the page."""
        try:
            await self._explore(frame, with_frames=True)
        except (DocumentGone, CommandFailed):
            self._worlds.pop(frame, None)
        except BrowserTimeout as error:
            return error
        return None

    async def _learn(self, frame: str, with_frames: bool) -> set[str]:
        """Ask about what one world cannot enter. Gives the frames found."""
        seconds = self._config.execute_seconds
        world = await self._enter(frame, seconds)
        asked = await self._evaluate(
            f"webgym.unknown({json.dumps(with_frames)})", world, seconds, group=frame
        )
        if not asked.object_id:
            return set()
        listed = await self._session.call(
            "Runtime.getProperties",
            {"objectId": asked.object_id, "ownProperties": True},
            reply=Properties,
            seconds=seconds,
        )
        handles = [one.value.object_id for one in listed.result if one.name.isdigit() and one.value]
        described = await asyncio.gather(*(self._describe(handle, world, frame) for handle in handles))
        ids = [node.frame_id for node in described]
        await self._evaluate(f"webgym.learn({json.dumps(ids)})", world, seconds)
        found = {one for one in ids if one}
        for one in found:
            self._parents[one] = frame
        self.in_view |= found
        return found

    async def _describe(self, handle: str, world: int, group: str) -> Node:
        """What a frame's element, or the host of a root, is; a closed root is opened to the world."""
        try:
            described = await self._session.call(
                "DOM.describeNode",
                {"objectId": handle, "depth": 0},
                reply=Described,
                seconds=self._config.execute_seconds,
            )
            for root in described.node.shadow_roots:
                if root.shadow_root_type == "closed":
                    await self._open_root(handle, root.backend_node_id, world, group)
        except CommandFailed:
            return Node()  # it left the page meanwhile
        return described.node

    async def _open_root(self, host: str, root: int, world: int, group: str) -> None:
        seconds = self._config.execute_seconds
        resolved = await self._session.call(
            "DOM.resolveNode",
            {"backendNodeId": root, "executionContextId": world, "objectGroup": group},
            reply=Resolved,
            seconds=seconds,
        )
        call = {
            "objectId": host,
            "functionDeclaration": "function (root) { webgym.enterRoot(this, root); }",
            "arguments": [{"objectId": resolved.object.object_id}],
        }
        await self._session.do("Runtime.callFunctionOn", call, seconds=seconds)

    # --- frames of other origins --------------------------------------------------------------------

    async def gather(self, wanted: dict[str, bool], more: Iterable[str] = ()) -> msgspec.Raw:
        """What the frames in view, and these, show: ``{id: {world, items}}``, for the tab's own frame to
        go over. One that moves on meanwhile shows nothing."""
        frames = {*self._entered_in_view(), *more}
        shown = await asyncio.gather(*(self._gather(frame, wanted) for frame in frames))
        return msgspec.Raw(msgspec.json.encode(dict(zip(frames, shown, strict=True))))

    async def _gather(self, frame: str, wanted: dict[str, bool]) -> dict[str, object]:
        try:
            items = await self.run(
                "gather", wanted, reply=msgspec.Raw, seconds=self._config.execute_seconds, frame=frame
            )
        except (DocumentGone, CommandFailed):
            return {"world": 0, "items": []}
        return {"world": self._worlds.get(frame, 0), "items": items}

    async def stand_still(self) -> bool:
        """Wait until the frames in view stand still. Gives whether they did so already.

        What keeps on changing for ``busy_seconds`` is not waited for again.
        """
        try:
            async with asyncio.timeout(self._config.busy_seconds):
                was_still = True
                while (rest := await self._unrest()) > 0:
                    was_still = False
                    await asyncio.sleep(rest)
                return was_still
        except TimeoutError:
            self._restless |= {self._worlds[frame] for frame in self._entered_in_view()}
            return False

    async def _unrest(self) -> float:
        """Seconds until the frames in view have been still for as long as a quiet page is."""
        frames = [one for one in self._entered_in_view() if self._worlds[one] not in self._restless]
        stills = await asyncio.gather(*(self._still(frame) for frame in frames))
        quiet = self._config.quiet_seconds
        return max((quiet - still.ago / 1000 for still in stills if still.changes), default=0.0)

    async def _still(self, frame: str) -> DocumentActivity:
        try:
            return await self.run(
                "still", reply=DocumentActivity, seconds=self._config.execute_seconds, frame=frame
            )
        except (DocumentGone, CommandFailed):
            return DocumentActivity(0, 0.0)

    def _entered_in_view(self) -> list[str]:
        return [frame for frame in self._worlds if self._below_main(frame) in self.in_view]

    def _below_main(self, frame: str) -> str:
        """The frame itself, or the one above it that the tab's own frame holds."""
        while (above := self._parents.get(frame, self._main)) in self._worlds and above != self._main:
            frame = above
        return frame

    async def outward(self, frame: str, point: tuple[float, float]) -> tuple[float, float]:
        """A point of a frame's viewport, in the tab's."""
        seconds = self._config.execute_seconds
        while frame != self._main:
            above = self._parents.get(frame, self._main)
            point = await self.run(
                "outward", frame, point, reply=tuple[float, float], seconds=seconds, frame=above
            )
            frame = above
        return point

    @property
    def entered(self) -> list[str]:
        """The frames of other origins that have a world."""
        return [frame for frame in self._worlds if frame != self._main]

    # --- what the browser tells ---------------------------------------------------------------------

    def _on_attached(self, event: FrameAttached) -> None:
        self._parents[event.frame_id] = event.parent_frame_id
        self._has_new_frames = True

    def _on_navigated(self, event: FrameNavigated) -> None:
        frame = event.frame.id
        if frame == self._main:
            self.forget()
            self._has_new_frames = False
            self._restless.clear()
        else:
            self._worlds.pop(frame, None)
            self._has_new_frames = True

    def _on_detached(self, event: FrameEvent) -> None:
        self._worlds.pop(event.frame_id, None)
        self._parents.pop(event.frame_id, None)
        self.in_view.discard(event.frame_id)
