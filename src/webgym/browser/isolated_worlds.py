"""WebGym's scripts in the page: an isolated world in the main frame, and one in every frame of another
origin below it, which the first cannot access.

All of a slot's frames share one renderer and one session. A frame of another origin is entered once per
document: the world of its parent provides the frame's element, the protocol gives the frame's id, and an
isolated world is created there. Closed shadow roots, which no script can access, are made available to the
isolated worlds in the same way. A page that has neither costs no round trip.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import Iterable, Mapping
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
_QUOTED_LENGTH = 300

_FILES = (
    "dom page caret settle geometry lists sliders typing labels roles native reach wheel pointer effect"
    " early drawing boxes sight targets beside observe aim document"
).split()
_SCRIPTS = resources.files("webgym.browser") / "scripts"
_LISTENERS = (_SCRIPTS / "listeners.js").read_text("utf-8").rstrip()
_SCRIPT = "".join((_SCRIPTS / f"{name}.js").read_text("utf-8") for name in _FILES)

_FIELDS = ("input", "textarea")
"""Elements whose parts, which no page can see, are opened to us: there, the caret is hidden."""

_WORLD_IS_GONE = (
    "Cannot find context",
    "context was destroyed",
    "navigated or closed",
    "No frame for given id",
    "Could not find object",
    "does not belong to the document",
    "Internal error",  # WebGym's script was terminated together with the page's own
)

# A page may contain hundreds of megabytes of each. Longer content is truncated in the page, before it reaches
# the records, and a notice says so.
TITLE_CHARACTERS = 1_000
"""Longest title."""

ADDRESS_CHARACTERS = 4_096
"""Longest URL, of the page and of a link. Search and log-in pages use 2,000; data URLs have no limit."""

TEXT_CHARACTERS = 100_000
"""Longest visible text; also the limit of all field values together, and of all values and addresses of
elements together. A viewport full of small print has 15,000."""

NAME_CHARACTERS = 200
"""Longest name of an element, and of an option in an open list."""

VALUE_CHARACTERS = 10_000
"""Longest value of a field: more than an agent writes in one action."""

OBSERVED_ELEMENTS = 2_000
"""Most elements in an observation. Busy viewports have 200; the marks of many more would overlap."""

LISTED_OPTIONS = 1_000
"""Most options in the open list of a dropdown. The others can be chosen by typing their text."""


class DocumentGone(BrowserError):
    """The page navigated to another document while a script ran in it."""

    code = "browser_document_gone"


class DocumentActivity(msgspec.Struct, frozen=True):
    """The activity of a document.

    Attributes:
        changes: number of changes so far.
        ago: milliseconds since the last change.
        timers: number of timers that it set.
    """

    changes: int
    ago: float
    timers: int = 0


class Worlds:
    """The isolated worlds of one tab.

    Args:
        session: the tab's session.
        main_frame: id of its main frame.
        config: the slot's limits.
    """

    def __init__(self, session: Session, main_frame: str, config: BrowserConfig) -> None:
        self.in_view: set[str] = set()
        """Frames of other origins that were in the viewport at the last observation."""
        self._session = session
        self._main = main_frame
        self._config = config
        self._limits = json.dumps(
            {
                "title": TITLE_CHARACTERS,
                "address": ADDRESS_CHARACTERS,
                "text": TEXT_CHARACTERS,
                "name": NAME_CHARACTERS,
                "value": VALUE_CHARACTERS,
                "elements": OBSERVED_ELEMENTS,
                "options": LISTED_OPTIONS,
            }
        )
        self._question = f"webgym-{secrets.token_hex()}"
        """Type of the event that asks the page's own world for its event listeners."""
        self._worlds: dict[str, int] = {}
        """Execution context of the isolated world, by frame; it ends with the document."""
        self._parents: dict[str, str] = {}
        """Parent frame of every frame below the main one."""
        self._has_new_frames = False
        self._never_quiet: set[int] = set()
        """Worlds of frames that never stop changing, so that settling ignores them."""
        self.timers: dict[int, int] = {}
        """Number of timers set by the frames of other origins in view, by world."""
        self.changes: dict[int, int] = {}
        """Number of their changes, without those that never stop changing."""
        session.on("Page.frameAttached", FrameAttached, self._on_attached)
        session.on("Page.frameNavigated", FrameNavigated, self._on_navigated)
        session.on("Page.frameDetached", FrameEvent, self._on_detached)

    @property
    def script_in_page(self) -> dict[str, object]:
        """Parameters of ``Page.addScriptToEvaluateOnNewDocument`` for the script in the page's own world."""
        return {"source": f"{_LISTENERS}('{self._question}')", "includeCommandLineAPI": True}

    # --- calls --------------------------------------------------------------------------------------

    async def run(
        self, function: str, *arguments: object, reply: type[T], seconds: float, frame: str | None = None
    ) -> T:
        """Call ``webgym.<function>`` and wait for its result.

        Args:
            function: name of the function.
            arguments: JSON values; :class:`msgspec.Raw` is JSON already.
            reply: type of the result.
            seconds: deadline.
            frame: the frame to call it in; ``None`` is the main frame.

        Raises:
            DocumentGone: the frame navigated to another document in the meantime.
            BrowserTimeout: the page did not answer in time.
        """
        frame = frame or self._main
        arguments_json = ",".join(
            bytes(argument).decode() if isinstance(argument, msgspec.Raw) else json.dumps(argument)
            for argument in arguments
        )
        try:
            world = await self._enter(frame, seconds)
            value = await self._evaluate(f"webgym.{function}({arguments_json})", world, seconds)
        except CommandFailed as error:
            self._raise_if_gone(error, frame)
            raise
        return msgspec.json.decode(value.value, type=reply)

    @property
    def is_entered(self) -> bool:
        """Whether the main frame has its world; then concurrent calls are answered in their order."""
        return self._main in self._worlds

    def post(self, function: str) -> None:
        """Call ``webgym.<function>()`` in the main frame, before any later call; do not wait."""
        world = self._worlds.get(self._main)
        if world is not None:
            self._session.send("Runtime.evaluate", {"expression": f"webgym.{function}()", "contextId": world})

    def forget(self) -> None:
        """Forget all worlds: the renderer is gone."""
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
        """Evaluate an expression: the result by value; in an object group, as a handle."""
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
            reason = thrown.description if thrown and thrown.description else evaluated.exception_details.text
            raise CommandFailed(f"a script of WebGym failed in the page: {reason[:_QUOTED_LENGTH]}")
        return evaluated.result

    def _raise_if_gone(self, error: CommandFailed, frame: str) -> None:
        if any(words in error.message for words in _WORLD_IS_GONE):
            self._worlds.pop(frame, None)
            raise DocumentGone(error.message) from error

    # --- entering frames and shadow roots -----------------------------------------------------------

    @property
    def has_new_frames(self) -> bool:
        """Whether a frame was added or has navigated since :meth:`explore`."""
        return self._has_new_frames

    async def explore(self, *, again: bool = False) -> None:
        """Enter new frames of other origins and closed shadow roots.

        Args:
            again: whether to search for frames even if none was added or has navigated.

        Raises:
            DocumentGone: the tab navigated in the meantime.
            BrowserTimeout: the page did not answer in time.
        """
        with_frames = self._has_new_frames or again
        self._has_new_frames = False
        await self._explore(self._main, with_frames)

    async def _explore(self, frame: str, with_frames: bool) -> None:
        """Enter what one world cannot access, and continue recursively in the frames that were entered."""
        below = {known for known in self._worlds if self._parents.get(known) == frame}
        try:
            below |= await self._enter_from(frame, with_frames)
        except CommandFailed as error:
            self._raise_if_gone(error, frame)
            raise
        finally:
            self._session.send("Runtime.releaseObjectGroup", {"objectGroup": frame})
        for timeout in await asyncio.gather(*(self._explore_below(child) for child in below)):
            if timeout is not None:
                raise timeout

    async def _explore_below(self, frame: str) -> BrowserTimeout | None:
        """Explore a frame below. One that is removed or cannot be entered is ignored; a timeout is
        returned."""
        try:
            await self._explore(frame, with_frames=True)
        except (DocumentGone, CommandFailed):
            self._worlds.pop(frame, None)
        except BrowserTimeout as error:
            return error
        return None

    async def _enter_from(self, frame: str, with_frames: bool) -> set[str]:
        """Enter the frames and shadow roots that one world cannot access. Returns the frames' ids."""
        seconds = self._config.execute_seconds
        world = await self._enter(frame, seconds)
        unknown = await self._evaluate(
            f"webgym.unknown({json.dumps(with_frames)})", world, seconds, group=frame
        )
        if not unknown.object_id:
            return set()
        properties = await self._session.call(
            "Runtime.getProperties",
            {"objectId": unknown.object_id, "ownProperties": True},
            reply=Properties,
            seconds=seconds,
        )
        handles = [item.value.object_id for item in properties.result if item.name.isdigit() and item.value]
        described = await asyncio.gather(*(self._describe(handle, world, frame) for handle in handles))
        ids = [node.frame_id for node in described]
        await self._evaluate(f"webgym.learn({json.dumps(ids)})", world, seconds)
        frames = {frame_id for frame_id in ids if frame_id}
        for frame_id in frames:
            self._parents[frame_id] = frame
        self.in_view |= frames
        return frames

    async def _describe(self, handle: str, world: int, group: str) -> Node:
        """Describe a frame's element, or the host of a shadow root; a closed root, or that of a
        field's parts, is opened to the world."""
        try:
            described = await self._session.call(
                "DOM.describeNode",
                {"objectId": handle, "depth": 0},
                reply=Described,
                seconds=self._config.execute_seconds,
            )
            for root in described.node.shadow_roots:
                if root.shadow_root_type == "closed" or described.node.local_name in _FIELDS:
                    await self._open_root(handle, root.backend_node_id, world, group)
        except CommandFailed:
            return Node()  # it was removed in the meantime
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

    async def gather(self, options: Mapping[str, bool | int], more: Iterable[str] = ()) -> msgspec.Raw:
        """The content of the frames of other origins, as JSON ``{id: {world, items}}`` for the main frame.

        Args:
            options: the content to read (see :func:`webgym.browser.observe.read_content`).
            more: frames to read besides those in view. A frame that navigates in the meantime is empty.
        """
        frames = {*self._entered_in_view(), *more}
        shown = await asyncio.gather(*(self._gather(frame, options) for frame in frames))
        return msgspec.Raw(msgspec.json.encode(dict(zip(frames, shown, strict=True))))

    async def _gather(self, frame: str, options: Mapping[str, bool | int]) -> dict[str, object]:
        try:
            items = await self.run(
                "gather", options, reply=msgspec.Raw, seconds=self._config.execute_seconds, frame=frame
            )
        except (DocumentGone, CommandFailed):
            return {"world": 0, "items": []}
        return {"world": self._worlds.get(frame, 0), "items": items}

    async def wait_until_quiet(self) -> bool:
        """Wait until the frames in view are quiet. Returns whether they were quiet already.

        Frames that go on changing for ``minor_seconds`` are ignored from then on.
        """
        try:
            async with asyncio.timeout(self._config.minor_seconds):
                was_quiet = True
                while (remaining := await self._seconds_until_quiet()) > 0:
                    was_quiet = False
                    await asyncio.sleep(remaining)
                return was_quiet
        except TimeoutError:
            self._never_quiet |= {self._worlds[frame] for frame in self._entered_in_view()}
            return False

    async def _seconds_until_quiet(self) -> float:
        """Seconds until the frames in view have been unchanged for ``quiet_seconds``."""
        frames = self._entered_in_view()
        worlds = [self._worlds[frame] for frame in frames]
        activities = await asyncio.gather(*(self._activity(frame) for frame in frames))
        remaining = 0.0
        for world, activity in zip(worlds, activities, strict=True):
            self.timers[world] = activity.timers
            if world not in self._never_quiet and activity.changes:
                self.changes[world] = activity.changes
                remaining = max(remaining, self._config.quiet_seconds - activity.ago / 1000)
        return remaining

    async def _activity(self, frame: str) -> DocumentActivity:
        try:
            return await self.run(
                "still", reply=DocumentActivity, seconds=self._config.execute_seconds, frame=frame
            )
        except (DocumentGone, CommandFailed):
            return DocumentActivity(0, 0.0)

    def _entered_in_view(self) -> list[str]:
        return [frame for frame in self._worlds if self._below_main(frame) in self.in_view]

    def _below_main(self, frame: str) -> str:
        """The frame itself, or its ancestor that is a child of the main frame."""
        while (above := self._parents.get(frame, self._main)) in self._worlds and above != self._main:
            frame = above
        return frame

    async def to_viewport(self, frame: str, point: tuple[float, float]) -> tuple[float, float]:
        """Convert a point of a frame's viewport to the tab's viewport."""
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

    # --- events -------------------------------------------------------------------------------------

    def _on_attached(self, event: FrameAttached) -> None:
        self._parents[event.frame_id] = event.parent_frame_id
        self._has_new_frames = True

    def _on_navigated(self, event: FrameNavigated) -> None:
        frame = event.frame.id
        if frame == self._main:
            self.forget()
            self._has_new_frames = False
            self._never_quiet.clear()
            self.timers, self.changes = {}, {}
        else:
            self._worlds.pop(frame, None)
            self._has_new_frames = True

    def _on_detached(self, event: FrameEvent) -> None:
        self._worlds.pop(event.frame_id, None)
        self._parents.pop(event.frame_id, None)
        self.in_view.discard(event.frame_id)
